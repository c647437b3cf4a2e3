"""DCMD against our rules for commands: which writes become commands, and which are refused; pure.

A host's write carries no client, no id and no token. So:

1. All writes are those of one configured operator; the broker's access list decides who may write.
2. A start or reset is dated by the payload's time, which the freshness rule of all commands judges
   (`issued_at`): within `ttl_s`, while our clock is synchronised. A metric's own time counts if it is older.
3. It is refused when it came before this connection's birth, or is older than that, or is retained.
4. Device, metric and time make its id: the same write again is answered, not carried out.
5. A stop needs none of that, and whatever else the same DCMD asks is refused. It acts wherever the Boolean
   value true is there, also beside another value or data type, and in a payload that is broken off after it.
6. All else acts only by the Boolean value true alone, of the type Boolean where one is given, in a payload
   that is whole. Every other value, and every other metric, is refused.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

from gateway.contract import STOP, CommandError, CommandRequest, Proof, ResultCode, rfc3339, shortened
from gateway.mqtt.commands import Rejection
from gateway.plugins.sparkplug.metrics import COMMANDS, ID_PREFIX, STOP_METRIC
from gateway.plugins.sparkplug.payload import HostCommand, HostWrite
from gateway.starters.policy.freshness import MAX_AHEAD_S

MOST_WRITES = 20  # of one message
SPARKPLUG = "sparkplug"  # the source of such commands, in the audit


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

    def judge(self, asked: DeviceCommand) -> Iterator[CommandRequest | Rejection]:
        """Yield one answer for each metric of a DCMD, the stops first, and one for all that are too many."""
        writes = asked.command.writes(MOST_WRITES, first=STOP_METRIC)
        has_stop = bool(writes) and _is_stop(writes[0])
        for write in writes:
            yield self._judged(asked, write, has_stop=has_stop)
        more = len(asked.command.metrics) - len(writes)
        if more:
            error = CommandError(ResultCode.TOO_MANY, "metrics", count=more, most=MOST_WRITES)
            yield self._refused(asked.starter, "?", _id_of(asked, asked.command.time_s, ""), error)

    def stop(self, asked: DeviceCommand) -> CommandRequest | Rejection | None:
        """Return the stop that a DCMD asks for, whatever else it asks; None when it asks for none."""
        for write in asked.command.writes(1, first=STOP_METRIC):
            if _is_stop(write):
                return self._command(asked, write, STOP, _id_of(asked, _issued_s(asked, write), write.name))
        return None

    def unread(self, starter: str, utc_s: float, error: CommandError) -> Rejection:
        """Return the refusal of DCMDs for a starter that were not looked into."""
        id_ = f"{ID_PREFIX}{round(utc_s * 1000)}-{error.code}"
        return self._refused(starter, "?", id_, error)

    def _judged(
        self, asked: DeviceCommand, write: HostWrite, *, has_stop: bool
    ) -> CommandRequest | Rejection:
        verb = COMMANDS.get(write.name)
        issued_s = _issued_s(asked, write)
        id_ = _id_of(asked, issued_s, write.name)
        if verb is None:
            name = shortened(write.name, 60) if write.name.isprintable() else "?"
            metrics = ", ".join(COMMANDS)
            error = CommandError(ResultCode.UNKNOWN_VERB, "metric", name=name, metrics=metrics)
            return self._refused(asked.starter, name, id_, error)
        if not write.is_true:
            error = CommandError(ResultCode.BAD_PAYLOAD, "not_true")
            return self._refused(asked.starter, verb, id_, error)
        if verb == STOP:
            return self._command(asked, write, verb, id_)
        if not write.is_plain:
            error = CommandError(ResultCode.BAD_PAYLOAD, "not_boolean")
            return self._refused(asked.starter, verb, id_, error)
        refusal = _stale(asked, write, issued_s)
        if refusal is not None:
            return self._refused(asked.starter, verb, id_, refusal)
        if has_stop:
            error = CommandError(ResultCode.BAD_PAYLOAD, "with_stop")
            return self._refused(asked.starter, verb, id_, error)
        return self._command(asked, write, verb, id_)

    def _command(
        self, asked: DeviceCommand, write: HostWrite, verb: str, id_: str
    ) -> CommandRequest | Rejection:
        if asked.is_retained:
            return self._refused(asked.starter, verb, id_, CommandError(ResultCode.RETAINED))
        issued_s = _issued_s(asked, write)
        return CommandRequest(
            starter=asked.starter,
            client=self.operator,
            verb=verb,
            id=id_,
            received_s=asked.now_s,
            proof=Proof(issued_s=None if issued_s is None else round(issued_s, 3), ttl_s=self.ttl_s),
            source=SPARKPLUG,
        )

    def _refused(self, starter: str, verb: str, id_: str, error: CommandError) -> Rejection:
        return Rejection(CommandRequest(starter, self.operator, verb, id_, source=SPARKPLUG), error)


def _is_stop(write: HostWrite) -> bool:
    return write.name == STOP_METRIC and write.is_true


def _stale(asked: DeviceCommand, write: HostWrite, issued_s: float | None) -> CommandError | None:
    """Return why a write is not fresh, as far as the general rule does not say it."""
    if write.is_historical:
        return CommandError(ResultCode.EXPIRED, "historical")
    if issued_s is None or rfc3339(issued_s) is None:
        return CommandError(ResultCode.NOT_FRESH, "no_timestamp")
    if asked.born_utc_s is None or issued_s - MAX_AHEAD_S < asked.born_utc_s:
        return CommandError(ResultCode.BEFORE_CONNECTION, "birth")
    return None


def _issued_s(asked: DeviceCommand, write: HostWrite) -> float | None:
    """Return the older of the two times; None without the payload's."""
    time_s = asked.command.time_s
    return time_s if time_s is None or not write.time_s else min(time_s, write.time_s)


def _id_of(asked: DeviceCommand, issued_s: float | None, name: str) -> str:
    """Return the id by which the same write is known again; of a write without a time, its arrival's."""
    time_ms = round((asked.utc_s if issued_s is None else issued_s) * 1000)
    digest = hashlib.blake2s(f"{asked.starter}/{name}".encode(), digest_size=6).hexdigest()
    return f"{ID_PREFIX}{time_ms}-{digest}"
