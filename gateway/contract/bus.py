"""How records travel: a writer dates, numbers and passes them on, `Latest` has the newest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import count, takewhile
from typing import Any, Protocol

from gateway.contract.events import Event, EventCode, event_of
from gateway.contract.records import EventRecord, ForgetRecord, Record
from gateway.system.clock import Clock


class Sink(Protocol):
    """Where records go; must return at once and never raise."""

    def put(self, record: Record) -> None:
        """Take one record, in order."""


class PublishEvent(Protocol):
    """Publishes an event of the gateway's own; must return at once and never raise."""

    def __call__(self, event: EventCode | Event, case: str = "", /, **fields: Any) -> None:
        """Take a code with what `event_of` needs besides, or an event."""


class RecordWriter:
    """Dates and numbers the records of this run (`boot`), and passes them on to everyone; on the app's loop.

    `put` never raises. The gateway has exactly one writer, whose numbers (`sequence`) go from 1 up.

    1. A subscriber gets the kinds that it names in `takes`; one that names none gets every record.
    2. The order is the subscribers' order in `connect`; whatever was put before goes to them first.
    3. A subscriber that fails loses that record alone: `on_failure` is called with it while its exception is
       handled, and the others get the record all the same.
    4. A record that a subscriber puts while it handles another one reaches all of them before that other goes
       on.
    """

    def __init__(self, clock: Clock, on_failure: Callable[[Sink], None], *, boot: str = "") -> None:
        self.clock = clock
        self.boot = boot
        self.sequence = count(1)
        self._on_failure = on_failure
        self._takers_of: Callable[[Any], tuple[Sink, ...]] | None = None  # by kind, once connected
        self._early: list[Record] = []  # put while the gateway was being built

    def connect(self, *subscribers: Sink) -> None:
        """Pass records on to these, in this order, from the first on; once."""

        def takers_of(kind: type[Record]) -> tuple[Sink, ...]:
            return tuple(each for each in subscribers if kind in getattr(each, "takes", (kind,)))

        self._takers_of = cache(takers_of)
        while self._early:
            self.put(self._early.pop(0))

    def put(self, record: Record) -> None:
        """Pass one record on."""
        if self._takers_of is None:
            self._early.append(record)
            return
        for subscriber in self._takers_of(type(record)):
            try:
                subscriber.put(record)
            except Exception:  # noqa: BLE001 - one subscriber's bug is not the others'; it is logged
                self._on_failure(subscriber)

    def event(self, starter: str, event: EventCode | Event, case: str = "", /, **fields: Any) -> None:
        """Publish an event that happens now, to a starter or (with an empty name) to the gateway."""
        self.put(self.dated(starter, event if isinstance(event, Event) else event_of(event, case, **fields)))

    def dated(self, starter: str, event: Event, *, time_s: float | None = None) -> EventRecord:
        """Return the record of an event that happened at `time_s`; None: now."""
        return EventRecord(
            starter=starter,
            seq=next(self.sequence),
            time_s=self.clock.utc_s() if time_s is None else time_s,
            boot=self.boot,
            **event._asdict(),
        )


class Latest:
    """A sink of records: the newest of each retained topic, numbered in the order of their changes.

    A consumer that has seen everything up to a number asks for what is newer; one that begins asks for all.
    Of what is forgotten the topic remains, without a record. Given `earlier`, nothing is taken until `begin`:
    the same records need not be held twice while no consumer is there. On the app's loop.
    """

    def __init__(self, earlier: Callable[[], Iterable[Record]] | None = None) -> None:
        """`earlier` returns the newest records of all retained topics, in any order."""
        self._earlier = earlier  # until `begin`
        self.number = 0  # of the latest change
        self._newest: dict[str, tuple[int, Record | None]] = {}  # by topic, the latest changed last

    def begin(self) -> None:
        """Take what there is, and all that comes from now on; once is enough."""
        earlier, self._earlier = self._earlier, None
        for record in () if earlier is None else earlier():
            self.put(record)

    def put(self, record: Record) -> None:
        """Take a record; only retained ones matter, and what is to be forgotten of them."""
        if self._earlier is not None:
            return
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

    def _set(self, topic: str, record: Record | None) -> None:
        self.number += 1
        self._newest.pop(topic, None)
        self._newest[topic] = self.number, record
