"""The history of all starters: a subscriber of the record bus, fed with readings by the telemetry.

1. Nothing here is waited for: `put` and `take_readings` return at once, and an exception stays here.
2. A starter's history begins with its configuration and goes on when its polls change; a starter that is not
   configured any more leaves memory, and its rows stay on the disk.
3. What is stored on the disk is read once at the start; of a starter that comes later, when it comes. Until
   then its parts record without it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from operator import methodcaller
from pathlib import Path
from typing import Any

from gateway.contract import (
    AvailabilityRecord,
    CommandError,
    EventCode,
    EventRecord,
    InfoRecord,
    PublishEvent,
    Record,
    RecordWriter,
    ResultCode,
    ResultRecord,
    StateRecord,
)
from gateway.errors import StoreError
from gateway.plugins.history.service.counters import CountersPart
from gateway.plugins.history.service.delivery import UNDELIVERED, Delivery, PublishAgain
from gateway.plugins.history.service.part import HistoryPart, Surroundings
from gateway.plugins.history.service.settings import SettingsPart
from gateway.plugins.history.service.starts import StartHistory
from gateway.plugins.history.service.trips import TripPart
from gateway.starters.policy.policy import Policy
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.readings import Readings
from gateway.storage.history import HistoryStore
from gateway.storage.history_table import HistoryRow
from gateway.store import News, OnNews
from gateway.system.rate_limits import ChangeDetector

log = logging.getLogger(__name__)

CLOSE_WITHIN_S = 2.0

# The parts of a starter's history; a new one is plugged in here.
MakePart = Callable[[StarterSetup, Surroundings], HistoryPart]
# The counters come first: once they are restored, the starts and trips that the others end are counted.
PARTS: tuple[MakePart, ...] = (CountersPart, StartHistory, TripPart, SettingsPart)


class StarterHistory:
    """The parts of one starter, each guarded against the others' bugs."""

    def __init__(self, name: str, parts: Sequence[HistoryPart]) -> None:
        self.name = name
        self.parts = tuple(parts)
        self._bugs: dict[str, ChangeDetector] = {}  # by part

    def each(self, call: Callable[[HistoryPart], None]) -> None:
        """Have each part do something; a bug in one is logged, the same one once in a row."""
        for part in self.parts:
            try:
                call(part)
            except Exception as error:  # a part's bug is neither the line's nor the other parts'
                kind = type(part).__name__
                if self._bugs.setdefault(kind, ChangeDetector()).is_new(repr(error)):
                    log.exception("starter=%s part=%s lost a record of the history", self.name, kind)


class HistoryService:
    """Implements `Sink` and `PastListener`; all calls on the app's loop.

    Readings are handed over by themselves, not as values; starts and trips are its own, counted before that.
    """

    takes = (StateRecord, AvailabilityRecord, InfoRecord, EventRecord, ResultRecord)

    def __init__(
        self,
        state_dir: Path,
        setups: Iterable[StarterSetup],
        *,
        boot: str,
        records: RecordWriter,
        publish_event: PublishEvent,
        policy: Policy | None = None,
        publish_again: PublishAgain = lambda _: None,
        make_file: Callable[[Path, OnNews], HistoryStore] = HistoryStore,
    ) -> None:
        self._publish_event = publish_event
        self._store = make_file(state_dir, self._on_news)
        self._delivery = Delivery(
            records.sink,
            self._store,
            boot=boot,
            clock=records.clock,
            count=self._take_record,
            publish_again=publish_again,
        )
        self.delivered = self._delivery.delivered  # called with the key of what the broker has acknowledged
        self._here = Surroundings(boot, replace(records, sink=self._delivery), self._store, policy)
        self._is_away = False
        self._loading: set[asyncio.Task[None]] = set()
        self._unread: set[str] = set()  # starters whose rows could not be read
        self.starters: dict[str, StarterHistory] = {}
        for setup in setups:
            self._add(setup)

    async def stored(self, starter: str, kinds: Sequence[str]) -> list[HistoryRow]:
        """Return what the file has of these kinds of one starter, the oldest first; StoreError."""
        return (await self._store.load([starter], kinds)).get(starter, [])

    def start(self) -> None:
        """Begin to read and write the file."""
        self._store.start()
        self._load(tuple(self.starters))

    def put(self, record: Record) -> None:
        """Record what was published of a starter."""
        if isinstance(record, self.takes):
            self._take_record(record)

    def take_readings(self, starter: str, readings: Readings) -> None:
        """Record what was just read of a starter; never raises."""
        self._each(starter, methodcaller("take_readings", readings))

    def note_fault_data(
        self, starter: str, at_fault: Mapping[str, Mapping[str, Any]], history: Sequence[Mapping[str, Any]]
    ) -> None:
        """Record what a starter says of a trip."""
        self._each(starter, methodcaller("note_fault_data", at_fault, history))

    def note_own_rows(self, starter: str, rows: Mapping[str, float]) -> None:
        """Record what a starter has counted itself, and its settings."""
        self._each(starter, methodcaller("note_own_rows", rows))

    def follow(self, setups: Iterable[StarterSetup], *, changed: Iterable[str]) -> None:
        """Record these starters from now on; those of `changed` have another machine or other polls."""
        wanted = {setup.name: setup for setup in setups}
        for name in [name for name in self.starters if name not in wanted]:
            self.starters[name].each(methodcaller("close"))  # what that ends is counted while it is known
            del self.starters[name]
        self._delivery.release()  # before the broker forgets what is gone
        for name in changed:
            if name in self.starters and name in wanted:
                self.starters[name].each(methodcaller("follow", wanted[name]))
        new = [setup for name, setup in wanted.items() if name not in self.starters]
        for setup in new:
            self._add(setup)
        self._load(tuple(setup.name for setup in new))

    def set_baseline(self, starter: str, id_: str | None, client: str) -> Mapping[str, Any]:
        """Compare later starts with this one (None: the last good one) and return it; CommandError."""
        history = self.starters.get(starter)
        for part in () if history is None else history.parts:
            if isinstance(part, StartHistory):
                return part.choose_baseline(id_, client=client).to_dict()
        raise CommandError(ResultCode.NO_START, "none")

    async def loaded(self) -> None:
        """Return when everything that earlier runs have stored was read, or could not be."""
        while self._loading:
            await asyncio.wait(self._loading)

    async def flushed(self) -> None:
        """Return when everything that was put up to now is on the disk, or cannot be."""
        with suppress(StoreError):
            await self._store.row("", "", "")

    async def close(self) -> None:
        """End every record and write what waits, as far as the disk lets us."""
        for task in self._loading:
            task.cancel()
        for history in self.starters.values():
            history.each(methodcaller("close"))
        if not await self._store.close(within_s=CLOSE_WITHIN_S):
            log.error("the disk took too long: the latest starts and counters may be missing in the history")
        self._delivery.release()

    def _take_record(self, record: Record) -> None:
        self._each(getattr(record, "starter", ""), methodcaller("take_record", record))

    def _each(self, starter: str, call: Callable[[HistoryPart], None]) -> None:
        history = self.starters.get(starter)
        if history is not None:
            history.each(call)

    def _add(self, setup: StarterSetup) -> None:
        self.starters[setup.name] = StarterHistory(setup.name, [make(setup, self._here) for make in PARTS])

    def _load(self, names: Sequence[str]) -> None:
        if names:
            task = asyncio.get_running_loop().create_task(self._restore(names), name="history")
            self._loading.add(task)
            task.add_done_callback(self._loading.discard)

    async def _restore(self, names: Sequence[str]) -> None:
        """Read one starter after the other, so that never more than one's rows are in memory."""
        for name in names:
            rows: dict[str, list[HistoryRow]] = {}
            history = self.starters.get(name)
            is_late, is_read = name in self._unread, True
            kinds = [UNDELIVERED, *(kind for part in history.parts for kind in part.kinds)] if history else []
            try:
                rows = await self._store.load([name], kinds)
            except StoreError as error:
                log.warning("starter=%s the history of earlier runs cannot be read: %s", name, error)
                self._unread.add(name)
                is_read = False
            if history is None or history is not self.starters.get(name):
                continue
            for part in history.parts:
                if isinstance(part, StartHistory):
                    part.is_unread = not is_read
            if not is_late:
                history.each(methodcaller("restore", rows.get(name, [])))
            elif is_read:
                self._unread.discard(name)
                history.each(methodcaller("restore_late", rows.get(name, [])))
            await self._delivery.publish_left(name, rows.get(name, []))

    def _on_news(self, news: News, text: str) -> None:
        match news:
            case News.OPEN:
                log.info("history %s", text)
                if self._is_away:
                    self._publish_event(EventCode.HISTORY_AVAILABLE)
                self._is_away = False
                self._load(tuple(self._unread))
            case News.AWAY:
                self._is_away = True
                self._publish_event(EventCode.HISTORY_UNAVAILABLE, trouble=text)
            case News.LOST:
                self._publish_event(EventCode.HISTORY_LOST, trouble=text)
