"""DCMDs as they arrive: what is too large, too many or no payload is counted, and a stop gets through.

1. More than `MOST_BYTES` is not looked into: decoding takes time of the loop that carries out the stops.
2. Beyond `DECODED` a second only what is short and may hold a stop is decoded; whatever else it asks is
   counted with all commands of the operator.
3. Of what is no payload nothing acts.
4. Such refusals are counted: for each starter and reason one event and one result a second. A DCMD to
   a device that is no starter has an event alone, one a second for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from gateway.contract import (
    MAX_PAYLOAD_BYTES,
    CommandError,
    EventCode,
    ResultCode,
    shortened,
)
from gateway.mqtt import Incoming
from gateway.plugins.interface import Gateway
from gateway.plugins.sparkplug.commands import CommandMapper, DeviceCommand
from gateway.plugins.sparkplug.metrics import COMMANDS, ID_PREFIX, STOP_METRIC
from gateway.plugins.sparkplug.payload import decoded_command
from gateway.system.rate_limits import Bucket, Damped, Rate

MOST_BYTES = MAX_PAYLOAD_BYTES  # as on the gateway's own topics
DECODED = Rate(20.0, 100)  # as the gateway's own topics take of one client
SHORT_BYTES = 512  # a stop alone has some 50; what is longer takes too long for as many as may come
REFUSED_EVERY_S = 1.0

_STOP = STOP_METRIC.encode("ascii")
_NAMES = {name: name.encode("ascii") for name in COMMANDS}


_Unread = tuple[str, CommandError]  # a starter, and why its DCMD was not looked into


class HostCommands:
    """Takes the DCMDs of all starters, on the app's loop; nothing that hosts send makes it raise.

    `show_done` shows these metrics of a starter as false again.
    """

    def __init__(
        self, mapper: CommandMapper, gateway: Gateway, show_done: Callable[[str, Collection[str]], None]
    ) -> None:
        self._mapper = mapper
        self._clock = gateway.clock
        self._commands = gateway.commands
        self._publish_event = gateway.publish_event
        self._show_done = show_done
        self._decoded = Bucket(DECODED)
        self._unread: Damped[_Unread] = Damped(self._refuse, clock=self._clock, every_s=REFUSED_EVERY_S)

    def take(self, starter: str, incoming: Incoming, born_utc_s: float | None) -> None:
        """Take a DCMD; `born_utc_s` is when this connection's birth was published."""
        payload = incoming.payload
        if len(payload) > MOST_BYTES:
            self._put(starter, CommandError(ResultCode.TOO_BIG, "dcmd", most=MOST_BYTES))
            return
        may_stop = _STOP in payload and len(payload) <= SHORT_BYTES
        if not self._decoded.take(self._clock.now_s()) and not may_stop:
            rate = DECODED.per_s
            self._put(starter, CommandError(ResultCode.TOO_MANY, "dcmds", rate=rate, most=SHORT_BYTES))
            return
        command = decoded_command(payload)
        if command is None:
            self._put(starter, CommandError(ResultCode.BAD_PAYLOAD, "broken"))
            return
        now_s, utc_s = self._clock.now_s(), self._clock.utc_s()
        asked = DeviceCommand(starter, command, incoming.is_retained, now_s, utc_s, born_utc_s)
        for each in self._mapper.judge(asked):
            self._commands.submit(*each)
        self._show_done(starter, [name for name, encoded in _NAMES.items() if encoded in payload])

    def refuse_unknown(self, device: str) -> None:
        """Refuse a DCMD to a device that is no starter; hosts choose its name, so it is no key."""
        error = CommandError(ResultCode.UNKNOWN_STARTER)
        self._unread.put(error.code, (shortened(device), error))

    def _put(self, starter: str, error: CommandError) -> None:
        self._unread.put((starter, error.code), (starter, error))

    def _refuse(self, unread: _Unread, count: int) -> None:
        starter, error = unread
        self._publish_event(
            EventCode.DCMD_REFUSED,
            "several" if count else "one",
            starter=starter,
            code=error.code,
            count=max(count, 1),
            why=error.text,
        )
        if error.code == ResultCode.UNKNOWN_STARTER:
            return  # no metric and no topic of such a starter could show a result
        id_ = f"{ID_PREFIX}{round(self._clock.utc_s() * 1000)}-{error.code}"
        self._commands.submit(*self._mapper.unread(starter, id_, error))
        self._show_done(starter, COMMANDS)
