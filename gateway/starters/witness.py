"""Stands between the starters and the sink: keeps the states that pass in the logbook, and adds the locks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gateway.clock import Clock
from gateway.starters.logbook import Logbook
from gateway.starters.records import Record, Sink, StateRecord
from gateway.starters.sequence import Sequence


class Witness:
    """A sink for the records of starters; `on_change` hears when the logbook has something new to keep."""

    def __init__(
        self,
        sink: Sink,
        logbook: Logbook,
        *,
        clock: Clock,
        sequence: Sequence,
        on_change: Callable[[], None],
    ) -> None:
        self._sink = sink
        self._logbook = logbook
        self._clock = clock
        self._sequence = sequence
        self._on_change = on_change
        self._states: dict[str, StateRecord] = {}

    def put(self, record: Record) -> None:
        """Pass a record on; a state with its starter's lock."""
        if not isinstance(record, StateRecord):
            self._sink.put(record)
            return
        if self._logbook.note_state(record.starter, record.state, now_s=self._clock.now_s()):
            self._on_change()
        self._states[record.starter] = record
        self._tell(record)

    def restate(self, starter: str) -> None:
        """Tell the state of a starter again, because its lock has changed."""
        record = self._states.get(starter)
        if record is not None:
            self._tell(replace(record, seq=self._sequence.take()))

    def _tell(self, record: StateRecord) -> None:
        self._sink.put(replace(record, is_lock_told=True, lock=self._logbook.lock_of(record.starter)))
