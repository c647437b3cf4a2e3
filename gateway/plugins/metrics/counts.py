"""Counts that only records show: commands, starts, trips; counted since the metrics were switched on; pure.

1. A repeated result is the same command, so it is counted once.
2. Clients choose some of the words in a result: what is no known verb counts as `other`, so that no
   client can make series without end.
3. The time of a command is that between its acceptance and its final result.
"""

from __future__ import annotations

from collections import Counter, defaultdict

from gateway.contract import EventCode, EventRecord, Phase, Record, ResultRecord, StartRecord, TripRecord
from gateway.system.stalls import DelayCounts, Delays

COMMAND_BOUNDS_S = (0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
MOST_PENDING = 1000  # commands between acceptance and final result; far beyond what the gateway takes
OTHER = "other"


class RecordCounts:
    """Takes every record, in order; `verbs` are those that exist."""

    def __init__(self, verbs: frozenset[str]) -> None:
        self._verbs = verbs
        self._counts: dict[str, Counter[tuple[str, ...]]] = defaultdict(Counter)
        self._times: dict[str, DelayCounts] = {}
        self._pending: dict[tuple[str, str, str | None, str], float] = {}

    def put(self, record: Record, now_s: float) -> None:
        """Count what a record says; most say nothing that is counted."""
        match record:
            case ResultRecord(is_duplicate=False):
                self._note_result(record, now_s)
            case StartRecord():
                self._counts["starts_total"][record.starter,] += 1
            case TripRecord():
                self._counts["trips_total"][record.starter, record.code] += 1
            case EventRecord(code=EventCode.START_DRIFT):
                self._counts["start_drifts_total"][record.starter,] += 1
            case _:
                pass  # the state itself is read at each scrape

    def counts(self) -> dict[str, dict[tuple[str, ...], int]]:
        """Return by metric what was counted, by the words that name a series in the catalogue's order.

        Of a starter it is its name alone.
        """
        return {name: dict(counts) for name, counts in self._counts.items()}

    def times(self) -> dict[str, Delays]:
        """Return by verb how long commands have taken."""
        return {verb: times.taken() for verb, times in self._times.items()}

    def _note_result(self, result: ResultRecord, now_s: float) -> None:
        verb = result.verb if result.verb in self._verbs else OTHER
        self._counts["commands_total"][verb, result.phase.value, result.code] += 1
        if result.phase is Phase.REJECTED:
            self._counts["commands_rejected_total"][result.code,] += 1
        elif result.phase is Phase.UNCONFIRMED:
            self._counts["commands_unconfirmed_total"][result.starter,] += 1
        key = (result.starter, result.client, result.id, verb)
        if result.phase is Phase.ACCEPTED and len(self._pending) < MOST_PENDING:
            self._pending[key] = now_s
        elif result.phase.is_final and key in self._pending:
            times = self._times.setdefault(verb, DelayCounts(COMMAND_BOUNDS_S))
            times.note(now_s - self._pending.pop(key))
