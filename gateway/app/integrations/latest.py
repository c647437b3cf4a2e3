"""The newest records of the site, so that what begins late, or anew, knows what was said before."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    InfoRecord,
    LineRecord,
    Record,
    StateRecord,
    ValueRecord,
)


class LatestRecords:
    """A sink of records, which retains the newest of each state, alarm and line; on the app's loop.

    The newest value of each point stands in the outbox: `values` reads it there once it is wanted.
    """

    takes = (StateRecord, AvailabilityRecord, InfoRecord, AlarmRecord, LineRecord)

    def __init__(self, values: Callable[[], Iterable[ValueRecord]]) -> None:
        self._values = values
        self._starters: dict[str, dict[object, Record]] = {}
        self._lines: dict[str, Record] = {}

    def put(self, record: Record) -> None:
        """Take a record, in order."""
        match record:
            case StateRecord() | AvailabilityRecord() | InfoRecord():
                self._of(record.starter)[type(record)] = record
            case AlarmRecord() if record.is_active:
                self._of(record.starter)[AlarmRecord, record.code] = record
            case AlarmRecord():
                self._of(record.starter).pop((AlarmRecord, record.code), None)
            case LineRecord():
                self._lines[record.line] = record
            case _:
                pass

    def forget(self, starters: Collection[str]) -> None:
        """Forget starters that are removed, or replaced by others of the same name."""
        for name in starters:
            self._starters.pop(name, None)

    def forget_line(self, line: str) -> None:
        """Forget a line that is configured no more."""
        self._lines.pop(line, None)

    def records(self) -> Iterator[Record]:
        """Yield the newest records, each starter's description before all else of it."""
        for retained in tuple(self._starters.values()):
            yield from sorted(retained.values(), key=lambda record: not isinstance(record, InfoRecord))
        yield from self._values()
        yield from tuple(self._lines.values())

    def _of(self, starter: str) -> dict[object, Record]:
        return self._starters.setdefault(starter, {})
