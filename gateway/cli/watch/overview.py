"""The starters of one gateway or many, as rows for a table, made of the records that these publish; pure.

A gateway is live while its freshness token changes (`gateway/fresh`, every second): a retained status says
nothing about now. A starter that is good at a live gateway answers now; else the time of its last good reply
counts, by that gateway's clock, so that the clock of this machine does not matter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from gateway.cli.command import coded
from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    FreshRecord,
    InfoRecord,
    Quality,
    Record,
    ResultRecord,
    StateRecord,
    StatusRecord,
    ValueRecord,
    read_record,
)

LIVE_WITHIN_S = 3.0  # without a new token for longer, a gateway is not live
TOPICS = (
    "gateway/status",
    "gateway/fresh",
    "starter/+/info",
    "starter/+/availability",
    "starter/+/state",
    "starter/+/alarm/+",
    "starter/+/value/current",
    "starter/+/value/current_pct",
    "result/+/+",
)
HINDRANCES = {  # of a motor at rest, by the flag of its state that is false then
    "configured": "not configured",
    "power_present": "no power",
    "general_enabled": "not enabled",
    "ready_to_start": "not ready to start",
}
KINDS: Mapping[str, type[Record]] = {
    "state": StateRecord,
    "availability": AvailabilityRecord,
    "value": ValueRecord,
    "alarm": AlarmRecord,
}
MOVING = ("starting", "running", "stopping")
SIGNALS = ("F", "C", "S", "")  # of NAMUR NE 107: failure, check (somebody works at it), out of specification
UNKNOWN = StateRecord(starter="", state="unknown", quality=Quality.BAD, time_s=None, seq=0)
ONLINE = AvailabilityRecord(starter="", state="online", since_s=0.0, reason=None)


@dataclass(slots=True)
class GatewayLine:
    """A gateway, and the difference of its clock to ours."""

    name: str
    status: StatusRecord | None = None
    token: str = ""
    live_at_s: float | None = None  # when the token last changed; None: not yet seen to change
    ahead_s: float = 0.0  # of the wall time that the caller gives

    def is_live(self, now_s: float) -> bool:
        """Return whether it has shown a new token lately, and has not ended."""
        is_recent = self.live_at_s is not None and now_s - self.live_at_s <= LIVE_WITHIN_S
        return is_recent and self.status is not None and self.status.state != "offline"


@dataclass(slots=True)
class StarterRow:
    """One starter as last published."""

    gateway: GatewayLine
    name: str
    state: StateRecord = UNKNOWN
    availability: AvailabilityRecord = ONLINE
    value: dict[str, ValueRecord] = field(default_factory=dict)  # by point
    alarm: dict[str, AlarmRecord] = field(default_factory=dict)  # by code
    result: ResultRecord | None = None  # of the last command
    title: str | None = None

    @property
    def alarms(self) -> Sequence[AlarmRecord]:
        """The active alarms and faults."""
        return [alarm for _, alarm in sorted(self.alarm.items()) if alarm.is_active]

    @property
    def is_good(self) -> bool:
        """Whether it was just read, as far as its gateway has said."""
        return self.state.quality is Quality.GOOD

    @property
    def signal(self) -> str:
        """The most important of `SIGNALS`."""
        presence, is_local = self.availability.state, self.state.flags.get("remote") is False
        severities = {alarm.severity for alarm in self.alarms}
        if self.state.state == "fault" or presence == "offline" or "fault" in severities:
            return "F"
        if self.state.lock or is_local or presence == "disabled":
            return "C"
        return "" if self.is_good and presence == "online" and not severities else "S"

    def troubles(self) -> Iterator[str]:
        """Yield in words what is wrong, the most important first."""
        state, presence, why = self.state, self.availability.state, self.availability.reason
        if presence != "online":
            yield f"{presence}: {why}" if why else presence
        yield from (coded(alarm.code, alarm.text) for alarm in self.alarms)
        if state.reason:
            yield state.reason
        if state.state == "not_ready":
            hindrances = [text for flag, text in HINDRANCES.items() if state.flags.get(flag) is False]
            yield ", ".join(hindrances) or "pausing or being adjusted"
        if state.lock is not None:
            yield f"locked by {state.lock.by}: {state.lock.reason}"
        if state.flags.get("remote") is False:
            yield "local"

    def commanded(self) -> Iterator[str]:
        """Yield the last command in words, if there was one."""
        if self.result is not None:
            code, phase = self.result.code, self.result.phase
            why = "" if code in ("", "ok", phase) else f" ({code})"
            yield f"{self.result.client} {self.result.verb}: {phase}{why}"

    def silent_s(self, now_s: float) -> float | None:
        """Return how long ago the last good reply came: 0 while it answers; None: it never did."""
        if self.is_good and self.gateway.is_live(now_s):
            return 0.0
        times = [time_s for time_s in (self.state.time_s, *(v.time_s for v in self.value.values())) if time_s]
        return max(now_s + self.gateway.ahead_s - max(times), 0.0) if times else None


class Overview:
    """Takes messages in any order and returns rows; a foreign or unreadable message changes nothing.

    `base` may have `+` in place of levels: one table for many gateways.
    """

    def __init__(self, base: str) -> None:
        self.gateways: dict[str, GatewayLine] = {}
        self._depth = base.count("/") + 1
        self._rows: dict[tuple[str, str], StarterRow] = {}

    def take(self, topic: str, payload: bytes, now_s: float) -> None:
        """Apply one message that came at `now_s` (seconds since 1970)."""
        levels = topic.split("/")
        name, rest = "/".join(levels[: self._depth]), levels[self._depth :]
        gateway = self.gateways.setdefault(name, GatewayLine(name))
        with suppress(ValueError):  # somebody else publishes below this base
            match rest:
                case ["gateway", "status"]:
                    gateway.status = read_record(StatusRecord, payload)
                case ["gateway", "fresh"]:
                    fresh = read_record(FreshRecord, payload)
                    if gateway.token not in ("", fresh.token):  # the first may have been retained for days
                        gateway.live_at_s, gateway.ahead_s = now_s, fresh.time_s - now_s
                    gateway.token = fresh.token
                case ["starter", starter, "state" | "availability"] if not payload:
                    self._rows.pop((name, starter), None)  # its gateway has it no longer
                case ["starter", starter, "state" | "availability" as kind]:
                    record = _read(kind, payload, starter)
                    setattr(self._row(gateway, starter), kind, record)
                case ["starter", starter, "info"] if payload:
                    record = read_record(InfoRecord, payload, starter=starter)
                    self._row(gateway, starter).title = record.title
                case ["starter", starter, "value" | "alarm" as kind, leaf] if not payload:
                    if (name, starter) in self._rows:  # the gateway has had it forgotten
                        getattr(self._rows[name, starter], kind).pop(leaf, None)
                case ["starter", starter, "value" | "alarm" as kind, leaf]:
                    record = _read(kind, payload, starter, leaf)
                    getattr(self._row(gateway, starter), kind)[leaf] = record
                case ["result", starter, client] if (name, starter) in self._rows:
                    result = read_record(ResultRecord, payload, starter=starter, client=client)
                    row = self._rows[name, starter]
                    row.result = row.result if result.is_duplicate else result

    def rows(self) -> Sequence[StarterRow]:
        """Return the starters, those first that somebody must look at."""

        def order(row: StarterRow) -> tuple[int, bool, str, str]:
            return SIGNALS.index(row.signal), row.state.state not in MOVING, row.gateway.name, row.name

        return sorted(self._rows.values(), key=order)

    def _row(self, gateway: GatewayLine, starter: str) -> StarterRow:
        return self._rows.setdefault((gateway.name, starter), StarterRow(gateway, starter))


def _read(kind: str, payload: bytes, starter: str, leaf: str = "") -> Record:
    return read_record(KINDS[kind], payload, starter=starter, point=leaf, code=leaf)
