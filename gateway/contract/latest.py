"""The newest record of each retained topic, numbered in the order of their changes; on the app's loop.

A consumer that has seen everything up to a number asks for what is newer; one that begins asks for all.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile

from gateway.contract.records import ForgetRecord, InfoRecord, Record


class Latest:
    """A sink of records; of what is forgotten the topic remains, without a record."""

    def __init__(self) -> None:
        self.number = 0  # of the latest change
        self._newest: dict[str, tuple[int, Record | None]] = {}  # by topic, the latest changed last

    def put(self, record: Record) -> None:
        """Take a record; only retained ones matter, and what is to be forgotten of them."""
        if isinstance(record, ForgetRecord):
            for topic in [topic for topic, (_, known) in self._newest.items() if known and record.has(topic)]:
                self._set(topic, None)
        elif record.RETAIN:
            self._set(record.topic, record)

    def newer_than(self, number: int) -> Iterator[tuple[str, Record | None]]:
        """Yield what has changed since a number, by topic, the latest first."""
        changed = takewhile(lambda each: each[1][0] > number, reversed(self._newest.items()))
        return ((topic, record) for topic, (_, record) in changed)

    def find(self, topic: str) -> Record | None:
        """Return the newest record of a topic below the base."""
        return self._newest.get(topic, (0, None))[1]

    def records(self) -> Iterator[Record]:
        """Yield all newest records, what a starter is before all else of it."""
        known = [record for _, record in self._newest.values() if record is not None]
        yield from sorted(known, key=lambda record: not isinstance(record, InfoRecord))

    def _set(self, topic: str, record: Record | None) -> None:
        self.number += 1
        self._newest.pop(topic, None)
        self._newest[topic] = self.number, record
