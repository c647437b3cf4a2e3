"""DCMD against our rules for commands: which writes become commands, and which are refused; pure.

A host's write carries no client, no id and no token. So:

1. All writes are those of one configured operator; the broker's access list decides who may write.
2. A start or reset is dated by the payload's time, which the freshness rule of all commands judges
   (`issued_at`): within `ttl_s`, while our clock is synchronised. A metric's own time counts if it is older.
3. It is refused when it came before this connection's birth, or is older than that, or is retained.
4. Device, metric and time make its id: the same write again is answered, not carried out.
5. A stop needs none of that, and whatever else the same DCMD asks is refused. It acts wherever the Boolean
   value true is there, also beside another value or data type.
6. All else acts only by the Boolean value true alone, of the type Boolean where one is given. Every other
   value, and every other metric, is refused.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

from gateway.contract import STOP, CommandError, CommandRequest, ResultCode, rfc3339, shortened
from gateway.plugins.sparkplug.metrics import COMMANDS, ID_PREFIX, STOP_METRIC
from gateway.plugins.sparkplug.payload import HostCommand, HostWrite
from gateway.starters import MAX_AHEAD_S

MOST_WRITES = 20  # of one message
SPARKPLUG = "sparkplug"  # the source of such commands, in the audit

Judgement = tuple[CommandRequest, CommandError | None]  # a command, and why it is refused unread, if it is


@dataclass(frozen=True, slots=True)
class DeviceCommand:
    """A DCMD as it came in, when (`now_s` on the steady clock), and when its connection's birth went out."""

    starter: str
    command: HostCommand
    is_retained: bool
    now_s: float
    utc_s: float
    born_utc_s: float | None


@dataclass(frozen=True, slots=True)
class CommandMapper:
    """Makes of each write the command that it is, or says why it is none."""

    operator: str
    ttl_s: float

    def judge(self, asked: DeviceCommand) -> Iterator[Judgement]:
        """Yield one answer for each metric of a DCMD, the stops first, and one for all that are too many."""
        writes = asked.command.writes(MOST_WRITES, first=STOP_METRIC)
        has_stop = any(write.name == STOP_METRIC and write.is_true for write in writes)
        for write in writes:
            yield self._request(asked, write), _refusal(asked, write, has_stop=has_stop)
        more = len(asked.command.metrics) - len(writes)
        if more:
            error = CommandError(ResultCode.TOO_MANY, "metrics", count=more, most=MOST_WRITES)
            yield self.unread(asked.starter, _id_of(asked, asked.command.time_s, ""), error)

    def unread(self, starter: str, id_: str, error: CommandError) -> Judgement:
        """Return the refusal of what was not looked into."""
        return CommandRequest(starter, self.operator, "?", id=id_, source=SPARKPLUG), error

    def _request(self, asked: DeviceCommand, write: HostWrite) -> CommandRequest:
        issued_s = _issued_s(asked, write)
        return CommandRequest(
            starter=asked.starter,
            client=self.operator,
            verb=COMMANDS.get(write.name) or _shown(write.name),
            id=_id_of(asked, issued_s, write.name),
            received_s=asked.now_s,
            issued_s=None if issued_s is None else round(issued_s, 3),
            ttl_s=self.ttl_s,
            source=SPARKPLUG,
        )


def _refusal(asked: DeviceCommand, write: HostWrite, *, has_stop: bool) -> CommandError | None:
    """Return why a write is no command, as far as the rules of all commands do not say it."""
    verb, issued_s = COMMANDS.get(write.name), _issued_s(asked, write)
    if verb is None:
        metrics = ", ".join(COMMANDS)
        return CommandError(ResultCode.UNKNOWN_VERB, "metric", name=_shown(write.name), metrics=metrics)
    if not write.is_true:
        return CommandError(ResultCode.BAD_PAYLOAD, "not_true")
    if verb != STOP:
        if not write.is_plain:
            return CommandError(ResultCode.BAD_PAYLOAD, "not_boolean")
        if write.is_historical:
            return CommandError(ResultCode.EXPIRED, "historical")
        if issued_s is None or rfc3339(issued_s) is None:
            return CommandError(ResultCode.NOT_FRESH, "no_timestamp")
        if asked.born_utc_s is None or issued_s - MAX_AHEAD_S < asked.born_utc_s:
            return CommandError(ResultCode.BEFORE_CONNECTION, "birth")
        if has_stop:
            return CommandError(ResultCode.BAD_PAYLOAD, "with_stop")
    return CommandError(ResultCode.RETAINED) if asked.is_retained else None


def _shown(name: str) -> str:
    return shortened(name, 60) if name.isprintable() else "?"


def _issued_s(asked: DeviceCommand, write: HostWrite) -> float | None:
    """Return the older of the two times; None without the payload's."""
    time_s = asked.command.time_s
    return time_s if time_s is None or not write.time_s else min(time_s, write.time_s)


def _id_of(asked: DeviceCommand, issued_s: float | None, name: str) -> str:
    """Return the id by which the same write is known again; of a write without a time, its arrival's."""
    time_ms = round((asked.utc_s if issued_s is None else issued_s) * 1000)
    digest = hashlib.blake2s(f"{asked.starter}/{name}".encode(), digest_size=6).hexdigest()
    return f"{ID_PREFIX}{time_ms}-{digest}"
