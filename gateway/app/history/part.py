"""What every part of a starter's history (starts, trips, counters) is given, and what it must do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gateway.history.readings import Readings
from gateway.records import Record, SequenceNumbers, Sink
from gateway.starters.policy.policy import Policy
from gateway.starters.setup import StarterSetup
from gateway.storage.history import HistoryStore
from gateway.storage.history_table import HistoryRow
from gateway.system.clock import Clock


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a part publishes to, stores in and takes time and numbers from."""

    boot: str  # names this run
    sink: Sink
    store: HistoryStore
    clock: Clock
    sequence: SequenceNumbers
    policy: Policy | None = None  # the rules for starts, and when there were some; None: no limits are known


class HistoryPart(Protocol):
    """One kind of history of one starter; all calls on the app's loop.

    An exception costs this part what it was just handed, and nothing else.
    """

    kinds: tuple[str, ...]  # of the rows that `restore` needs

    def take_readings(self, readings: Readings) -> None:
        """Record what was just read."""

    def take_record(self, record: Record) -> None:
        """Record what was just published of this starter."""

    def restore(self, rows: Sequence[HistoryRow]) -> None:
        """Go on from what earlier runs have stored of this starter, of its `kinds`, the oldest first; once.

        Readings may have come before; called with nothing when the disk cannot be read.
        """

    def follow(self, setup: StarterSetup) -> None:
        """Go on with another machine, or with other polls, under the same name: what was under way ends."""

    def close(self) -> None:
        """End what is under way and store what must outlive the gateway: it ends, or the starter is gone."""
