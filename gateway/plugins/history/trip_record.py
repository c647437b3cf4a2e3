"""The record of one trip: what came before it, and what the starter itself says of it; at most 16 KB."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from gateway.plugins.history.ring import ReadingTable

MOST_BYTES = 16 * 1024
ALWAYS_S = 10.0  # before the trip: what is nearer is thinned last
STORED = 100  # records of one starter on disk


@dataclass(frozen=True, slots=True)
class TripSnapshot:
    """One trip; times within `readings` are relative to the first reading that showed it."""

    id: str  # <boot>-<seq>
    time: str | None  # RFC 3339
    boot: str
    seq: int
    code: str  # of the fault alarm, lower case; `fault` where the starter gives no number
    text: str
    state_before: str | None  # None: found at the first reading
    readings: ReadingTable = field(default_factory=ReadingTable)
    at_fault: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # code -> value, unit, name
    fault_history: tuple[Mapping[str, Any], ...] = ()  # newest first: code, value, unit, name
    thinned: str = ""  # what was left out so that it fits

    def to_dict(self) -> dict[str, Any]:
        """Return what MQTT, the disk and `report` say alike."""
        data = {
            "id": self.id,
            "time": self.time,
            "boot": self.boot,
            "seq": self.seq,
            "code": self.code,
            "text": self.text,
            "state_before": self.state_before,
            "readings": self.readings.to_dict(),
            "at_fault": {code: dict(each) for code, each in self.at_fault.items()},
            "fault_history": [dict(each) for each in self.fault_history],
        }
        return data | ({"thinned": self.thinned} if self.thinned else {})


def fitted(trip: TripSnapshot) -> TripSnapshot:
    """Return the trip so that its JSON has at most `MOST_BYTES`.

    Every other moment goes that is older than `ALWAYS_S` before the trip, again and again; then every other
    one of what is left; then the starter's own rows, the last ones first.
    """
    count = len(trip.readings.t_s)
    while size_of(trip) > MOST_BYTES:
        rows = _dispensable(trip.readings)
        if rows:
            left = trip.readings.without(rows)
            text = f"{len(left.t_s)} of {count} moments are left, those before the trip were thinned first"
            trip = replace(trip, readings=left, thinned=text)
        elif trip.fault_history:
            trip = replace(trip, fault_history=trip.fault_history[:-1])
        elif trip.at_fault:
            trip = replace(trip, at_fault=dict(list(trip.at_fault.items())[:-1]))
        else:
            return replace(trip, readings=ReadingTable(), text=trip.text[:200])
    return trip


def size_of(trip: TripSnapshot) -> int:
    """Return the bytes of the compact JSON of a trip."""
    return len(json.dumps(trip.to_dict(), separators=(",", ":"), ensure_ascii=False).encode())


def _dispensable(table: ReadingTable) -> set[int]:
    """Return which rows go next; none when only two are left."""
    old = [row for row, t_s in enumerate(table.t_s) if t_s < -ALWAYS_S]
    if old:
        return set(old[::2])
    near = [row for row, t_s in enumerate(table.t_s) if t_s != 0.0][1:-1]
    return set(near[::2])
