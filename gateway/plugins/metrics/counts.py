"""What only records show: commands, starts, trips; counted since the metrics were switched on; pure.

1. A repeated result is the same command, so it is counted once.
2. Clients choose some of the words in a result: what is no known verb counts as `other`, so that no
   client can make series without end.
3. The time of a command is that between its acceptance and its final result.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from gateway.contract import (
    EventRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    StartRecord,
    TripRecord,
    ValueRecord,
)
from gateway.starters.telemetry.own_points import OWN_POINT_NAMES
from gateway.system.stalls import DelayCounts, Delays

COMMAND_BOUNDS_S = (0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
MOST_PENDING = 1000  # commands between acceptance and final result; far beyond what the gateway takes
OTHER = "other"
DRIFT = "start_drift"  # event


@dataclass(frozen=True, slots=True)
class Counted:
    """The counters at the moment of a scrape."""

    commands: Mapping[tuple[str, str, str], int]  # verb, phase, code
    command_times: Mapping[str, Delays]  # by verb
    rejected: Mapping[str, int]  # by code
    unconfirmed: Mapping[str, int]  # by starter
    starts: Mapping[str, int]
    trips: Mapping[tuple[str, str], int]  # starter, code
    drifts: Mapping[str, int]
    own_values: Mapping[tuple[str, str], ValueRecord]  # starter, point: of the gateway's own points


class RecordCounts:
    """Takes every record, in order; `verbs` are those that exist."""

    def __init__(self, verbs: frozenset[str], *, has_own_values: bool) -> None:
        self._verbs = verbs
        self._has_own_values = has_own_values
        self._commands: Counter[tuple[str, str, str]] = Counter()
        self._rejected: Counter[str] = Counter()
        self._unconfirmed: Counter[str] = Counter()
        self._starts: Counter[str] = Counter()
        self._trips: Counter[tuple[str, str]] = Counter()
        self._drifts: Counter[str] = Counter()
        self._times: dict[str, DelayCounts] = {}
        self._pending: dict[tuple[str, str, str | None, str], float] = {}
        self._own_values: dict[tuple[str, str], ValueRecord] = {}

    def put(self, record: Record, now_s: float) -> None:
        """Count what a record says; most say nothing that is counted."""
        match record:
            case ValueRecord():
                if self._has_own_values and record.point in OWN_POINT_NAMES:
                    self._own_values[record.starter, record.point] = record
            case ResultRecord():
                self._note_result(record, now_s)
            case StartRecord():
                self._starts[record.starter] += 1
            case TripRecord():
                self._trips[record.starter, record.code] += 1
            case EventRecord():
                if record.code == DRIFT:
                    self._drifts[record.starter] += 1
            case _:
                pass  # the state itself is read at each scrape

    def want_own_values(self, *, has_own_values: bool) -> None:
        """Record the gateway's own points from now on, or no longer."""
        self._has_own_values = has_own_values
        if not has_own_values:
            self._own_values.clear()

    def taken(self) -> Counted:
        """Return all that was counted so far."""
        good = {key: each for key, each in self._own_values.items() if each.quality is Quality.GOOD}
        return Counted(
            commands=dict(self._commands),
            command_times={verb: times.taken() for verb, times in self._times.items()},
            rejected=dict(self._rejected),
            unconfirmed=dict(self._unconfirmed),
            starts=dict(self._starts),
            trips=dict(self._trips),
            drifts=dict(self._drifts),
            own_values=good,
        )

    def _note_result(self, result: ResultRecord, now_s: float) -> None:
        if result.is_duplicate:
            return
        verb = result.verb if result.verb in self._verbs else OTHER
        self._commands[verb, result.phase.value, result.code] += 1
        if result.phase is Phase.REJECTED:
            self._rejected[result.code] += 1
        elif result.phase is Phase.UNCONFIRMED:
            self._unconfirmed[result.starter] += 1
        key = (result.starter, result.client, result.id, verb)
        if result.phase is Phase.ACCEPTED and len(self._pending) < MOST_PENDING:
            self._pending[key] = now_s
        elif result.phase.is_final and key in self._pending:
            times = self._times.setdefault(verb, DelayCounts(COMMAND_BOUNDS_S))
            times.note(now_s - self._pending.pop(key))
