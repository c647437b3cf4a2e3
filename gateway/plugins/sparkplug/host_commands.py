"""DCMDs as they arrive: what is too large, too many or broken is counted, and a stop gets through.

1. More than `MOST_BYTES` is not looked into: decoding takes time of the loop that carries out the stops.
2. Beyond `DECODED` a second only what is short and may hold a stop is decoded, and only a stop of it acts.
3. Of a payload that cannot be read as a whole a stop that is whole acts, and nothing else: its sender asked
   for it, and the worst that it can do is to stop.
4. What is refused so is counted: for each starter and reason one event and one result a second. A DCMD to
   a device that is no starter has an event alone, one a second for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

from gateway.contract import (
    MAX_PAYLOAD_BYTES,
    CommandError,
    CommandRequest,
    EventCode,
    Note,
    PublishEvent,
    Reason,
    ResultCode,
    shortened,
)
from gateway.mqtt.commands import Incoming, Rejection
from gateway.plugins.sparkplug.commands import CommandMapper, DeviceCommand
from gateway.plugins.sparkplug.metrics import COMMANDS, STOP_METRIC
from gateway.plugins.sparkplug.payload import decoded_command
from gateway.starters.commands.submit import Commands
from gateway.system.clock import Clock
from gateway.system.rate_limits import Bucket, Damped, Rate

MOST_BYTES = MAX_PAYLOAD_BYTES  # as on the gateway's own topics
DECODED = Rate(20.0, 100)  # as the gateway's own topics take of one client
SHORT_BYTES = 512  # a stop alone has some 50; what is longer takes too long for as many as may come
REFUSED_EVERY_S = 1.0

_STOP = STOP_METRIC.encode("ascii")
_NAMES = {name: name.encode("ascii") for name in COMMANDS}


@dataclass(frozen=True, slots=True)
class _Unread:
    """Why a DCMD for a starter was not looked into, or not to its end."""

    starter: str
    reason: Reason


class HostCommands:
    """Takes the DCMDs of all starters, on the app's loop; nothing that hosts send makes it raise.

    `show_done` shows these metrics of a starter as false again.
    """

    def __init__(
        self,
        mapper: CommandMapper,
        *,
        clock: Clock,
        commands: Commands,
        publish_event: PublishEvent,
        show_done: Callable[[str, Collection[str]], None],
    ) -> None:
        self._mapper = mapper
        self._clock = clock
        self._commands = commands
        self._publish_event = publish_event
        self._show_done = show_done
        self._decoded = Bucket(DECODED)
        self._unread = Damped(self._refuse, clock=clock, every_s=REFUSED_EVERY_S)

    def take(self, starter: str, incoming: Incoming, born_utc_s: float | None) -> None:
        """Take a DCMD; `born_utc_s` is when this connection's birth was published."""
        payload = incoming.payload
        if len(payload) > MOST_BYTES:
            self._put(starter, Reason(ResultCode.TOO_BIG, "dcmd", most=MOST_BYTES))
            return
        is_paid = self._decoded.take(self._clock.now_s())
        if not is_paid and (_STOP not in payload or len(payload) > SHORT_BYTES):
            rate = DECODED.per_s
            self._put(starter, Reason(ResultCode.TOO_MANY, "dcmds", rate=rate, most=SHORT_BYTES))
            return
        command = decoded_command(payload, salvaged=_STOP)
        asked = DeviceCommand(
            starter, command, incoming.is_retained, self._clock.now_s(), self._clock.utc_s(), born_utc_s
        )
        if is_paid and not command.is_broken:
            for each in self._mapper.judge(asked):
                self._pass_on(each)
        else:
            self._take_stop(asked)
        self._show_done(starter, [name for name, encoded in _NAMES.items() if encoded in payload])

    def refuse_unknown(self, device: str) -> None:
        """Refuse a DCMD to a device that is no starter; hosts choose its name, so it is no key."""
        reason = Reason(ResultCode.UNKNOWN_STARTER)
        self._unread.put(reason.code, _Unread(shortened(device), reason))

    def _take_stop(self, asked: DeviceCommand) -> None:
        """Take the stop of a DCMD of which nothing else may act."""
        stop = self._mapper.stop(asked)
        if stop is not None:
            self._pass_on(stop)
        if asked.command.is_broken:
            reason = Reason(ResultCode.BAD_PAYLOAD, "broken" if stop is None else "broken_stop")
            self._put(asked.starter, reason)
        elif stop is None or len(asked.command.metrics) > 1:
            self._put(asked.starter, Reason(ResultCode.TOO_MANY, "dcmds_but_stops", rate=DECODED.per_s))

    def _pass_on(self, judgement: CommandRequest | Rejection) -> None:
        if isinstance(judgement, Rejection):
            self._commands.reject(judgement.request, judgement.error)
        else:
            self._commands.submit(judgement)

    def _put(self, starter: str, reason: Reason) -> None:
        self._unread.put((starter, reason.code), _Unread(starter, reason))

    def _refuse(self, unread: _Unread, count: int) -> None:
        self._publish_event(
            EventCode.DCMD_REFUSED,
            "several" if count else "one",
            starter=unread.starter,
            code=unread.reason.code,
            count=max(count, 1),
            why=unread.reason.text,
        )
        if unread.reason.code == ResultCode.UNKNOWN_STARTER:
            return  # no metric and no topic of such a starter could show a result
        more = Note("more_dcmds", count=count) if count else None
        error = CommandError(unread.reason.noted(more))
        self._pass_on(self._mapper.unread(unread.starter, self._clock.utc_s(), error))
        self._show_done(unread.starter, COMMANDS)
