"""The starters of one gateway or many, as rows for a table, made of the records that these publish; pure.

A gateway is live while its freshness token changes (`gateway/fresh`, every second): a retained status says
nothing about now. A starter that is good at a live gateway answers now; else the time of its last good reply
counts, by that gateway's clock, so that the clock of this machine does not matter.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple, TypeVar

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
KINDS = (
    StatusRecord,
    FreshRecord,
    InfoRecord,
    AvailabilityRecord,
    StateRecord,
    AlarmRecord,
    ValueRecord,
    ResultRecord,
)
POINTS = ("current", "current_pct")
HINDRANCES = {  # of a motor at rest, by the flag of its state that is false then
    "configured": "not configured",
    "power_present": "no power",
    "general_enabled": "not enabled",
    "ready_to_start": "not ready to start",
}
MOVING = ("starting", "running", "stopping")
SIGNALS = ("F", "C", "S", "")  # of NAMUR NE 107: failure, check (somebody works at it), out of specification
UNKNOWN = StateRecord(starter="", state="unknown", quality=Quality.BAD, time_s=None, seq=0)
ONLINE = AvailabilityRecord(starter="", state="online", since_s=0.0, reason=None)

R = TypeVar("R", bound=Record)


def filters() -> Iterator[str]:
    """Yield the topics to subscribe to, below the base of the gateways."""
    for kind in KINDS:
        points = POINTS if kind is ValueRecord else ("+",)
        yield from (re.sub(r"{\w+}", "+", kind.TOPIC.replace("{point}", point)) for point in points)


class GatewayRecords:
    """The newest records of one gateway, and the difference of its clock to ours."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.live_at_s: float | None = None  # when its token last changed; None: not yet seen to change
        self.ahead_s = 0.0  # of the wall time that the caller gives
        self._records: dict[str, Record] = {}  # by topic below the base, the newest last

    @property
    def status(self) -> StatusRecord | None:
        """The gateway's own state."""
        status = self._records.get(StatusRecord.TOPIC)
        return status if isinstance(status, StatusRecord) else None

    def put(self, topic: str, record: Record | None, now_s: float) -> None:
        """Take a record; None: the gateway has had the broker forget it."""
        if isinstance(record, ResultRecord) and record.is_duplicate:
            return
        before = self._records.pop(topic, None)
        # The first token may have been retained for days: only one that follows it proves anything.
        if isinstance(record, FreshRecord) and before not in (None, record):
            self.live_at_s, self.ahead_s = now_s, record.time_s - now_s
        if record is not None:
            self._records[topic] = record
        elif isinstance(before, StateRecord | AvailabilityRecord):  # the starter is gone, and all of it
            others = self._records.items()
            self._records = {
                at: each for at, each in others if getattr(each, "starter", "") != before.starter
            }

    def is_live(self, now_s: float) -> bool:
        """Return whether it has shown a new token lately, and has not ended."""
        is_recent = self.live_at_s is not None and now_s - self.live_at_s <= LIVE_WITHIN_S
        return is_recent and self.status is not None and self.status.state != "offline"

    def rows(self) -> Iterator[StarterRow]:
        """Yield its starters: of each there is a state, or at least whether it can be reached."""
        found: dict[str, list[Record]] = {}
        for record in self._records.values():
            found.setdefault(getattr(record, "starter", ""), []).append(record)
        for name, records in found.items():
            if any(isinstance(record, StateRecord | AvailabilityRecord) for record in records):
                yield StarterRow(self, name, records)


class StarterRow(NamedTuple):
    """One starter as last published."""

    gateway: GatewayRecords
    name: str
    records: Sequence[Record]  # the newest last

    @property
    def state(self) -> StateRecord:
        """The state."""
        return next(self._all(StateRecord), UNKNOWN)

    @property
    def title(self) -> str:
        """The title that its configuration gives it, else its name."""
        return next((each.title for each in self._all(InfoRecord) if each.title), self.name)

    @property
    def alarms(self) -> list[AlarmRecord]:
        """The active alarms and faults."""
        return sorted((each for each in self._all(AlarmRecord) if each.is_active), key=lambda each: each.code)

    @property
    def is_good(self) -> bool:
        """Whether it was just read, as far as its gateway has said."""
        return self.state.quality is Quality.GOOD

    @property
    def signal(self) -> str:
        """The most important of `SIGNALS`."""
        state, presence = self.state, next(self._all(AvailabilityRecord), ONLINE).state
        severities = {alarm.severity for alarm in self.alarms}
        if state.state == "fault" or presence == "offline" or "fault" in severities:
            return "F"
        if state.lock or state.flags.get("remote") is False or presence == "disabled":
            return "C"
        return "" if self.is_good and presence == "online" and not severities else "S"

    def value(self, point: str) -> ValueRecord | None:
        """Return the newest value of a point."""
        return next((each for each in self._all(ValueRecord) if each.point == point), None)

    def texts(self) -> Iterator[str]:
        """Yield in words what is wrong, the most important first, then the last command."""
        state, presence = self.state, next(self._all(AvailabilityRecord), ONLINE)
        if presence.state != "online":
            yield f"{presence.state}: {presence.reason}" if presence.reason else presence.state
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
        for result in list(self._all(ResultRecord))[-1:]:
            why = "" if result.code in ("", "ok", result.phase) else f" ({result.code})"
            yield f"{result.client} {result.verb}: {result.phase}{why}"

    def silent_s(self, now_s: float) -> float | None:
        """Return how long ago the last good reply came: 0 while it answers; None: it never did."""
        if self.is_good and self.gateway.is_live(now_s):
            return 0.0
        seen = (self.state.time_s, *(each.time_s for each in self._all(ValueRecord)))
        times = [time_s for time_s in seen if time_s]
        return max(now_s + self.gateway.ahead_s - max(times), 0.0) if times else None

    def _all(self, kind: type[R]) -> Iterator[R]:
        return (record for record in self.records if isinstance(record, kind))


class Overview:
    """Takes messages in any order and returns rows; a foreign or unreadable message changes nothing.

    `base` may have `+` in place of levels: one table for many gateways.
    """

    def __init__(self, base: str) -> None:
        self._gateways: dict[str, GatewayRecords] = {}
        self._depth = base.count("/") + 1

    def take(self, topic: str, payload: bytes, now_s: float) -> None:
        """Apply one message that came at `now_s` (seconds since 1970)."""
        levels = topic.split("/")
        base, rest = "/".join(levels[: self._depth]), "/".join(levels[self._depth :])
        for kind in KINDS:
            if (names := kind.names_of(rest)) is not None:
                with suppress(ValueError):  # somebody else publishes below this base
                    record = read_record(kind, payload, **names) if payload else None
                    self._gateways.setdefault(base, GatewayRecords(base)).put(rest, record, now_s)

    def gateways(self) -> Sequence[GatewayRecords]:
        """Return the gateways by name, without those that have had themselves forgotten."""
        known = sorted(self._gateways.items())
        return [gateway for _, gateway in known if gateway.status is not None or any(gateway.rows())]

    def rows(self) -> Sequence[StarterRow]:
        """Return the starters, those first that somebody must look at."""

        def order(row: StarterRow) -> tuple[int, bool, str, str]:
            return SIGNALS.index(row.signal), row.state.state not in MOVING, row.gateway.name, row.name

        return sorted((row for gateway in self.gateways() for row in gateway.rows()), key=order)
