"""What every part of a starter's history (starts, trips, counters) is given, and what it must do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gateway.contract import Record, RecordWriter
from gateway.starters.policy.policy import Policy
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.readings import Readings
from gateway.storage.history import HistoryStore
from gateway.storage.history_table import HistoryRow


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a part publishes to, stores in and takes time and numbers from."""

    boot: str  # names this run
    records: RecordWriter
    store: HistoryStore
    policy: Policy | None = None  # the rules for starts, and when there were some; None: no limits are known


class HistoryPart:
    """One kind of history of one starter; all calls on the app's loop.

    What a part does not define does nothing. An exception costs this part what it was just handed, no more.
    """

    kinds: tuple[str, ...] = ()  # of the rows that `restore` needs

    def __init__(self, setup: StarterSetup, here: Surroundings) -> None:
        self._name = setup.name
        self._here = here
        self._records = here.records

    def take_readings(self, readings: Readings) -> None:
        """Record what was just read."""

    def take_record(self, record: Record) -> None:
        """Record what was just published of this starter."""

    def note_fault_data(
        self, at_fault: Mapping[str, Mapping[str, Any]], history: Sequence[Mapping[str, Any]]
    ) -> None:
        """Record what was read of the starter after a trip."""

    def note_own_rows(self, rows: Mapping[str, float]) -> None:
        """Record what the starter itself has counted, and its settings; by code, just read."""

    def restore(self, rows: Sequence[HistoryRow]) -> None:
        """Go on from what earlier runs have stored of this starter, of its `kinds`, the oldest first; once.

        Readings may have come before; called with nothing when the disk cannot be read.
        """

    def restore_late(self, rows: Sequence[HistoryRow]) -> None:
        """Restore what could not be read before; the rows of this run since then are among them."""

    def follow(self, setup: StarterSetup) -> None:
        """Go on with another machine, or with other polls, under the same name: what was under way ends."""

    def close(self) -> None:
        """End what is under way and store what must outlive the gateway: it ends, or the starter is gone."""

    def _put(
        self, kind: str, id_: str, data: Mapping[str, Any], *, limit: int, is_urgent: bool = False
    ) -> None:
        """Store a row of this starter; see `HistoryStore.put`."""
        utc_s = self._records.clock.utc_s()
        put = self._here.store.put
        put(self._name, kind, id_, time_s=utc_s, data=data, limit=limit, is_urgent=is_urgent)
