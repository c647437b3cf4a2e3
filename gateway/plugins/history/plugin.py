"""The history of all motors: fed with records and readings, it records, counts, stores and publishes.

1. Nothing here is waited for: `put` and `take_readings` return at once, and an exception stays here.
2. A motor's history begins with its configuration and goes on when its polls change; a starter that is not
   configured any more leaves memory, and its rows stay on the disk.
3. The stored rows are read once at the start; of a starter that comes later, when it comes. Until
   then its starts, trips and hours are recorded without it.
"""

from __future__ import annotations

import asyncio
import logging
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from operator import methodcaller
from typing import Any, NamedTuple

from gateway.contract import (
    CommandError,
    EventCode,
    EventRecord,
    InfoRecord,
    PublishEvent,
    Record,
    RecordWriter,
    ResultCode,
    ResultRecord,
    StartRecord,
    StateRecord,
    TripRecord,
    ValueRecord,
    rfc3339,
)
from gateway.errors import StoreError
from gateway.plugins.history.counters import KIND as COUNTERS
from gateway.plugins.history.delivery import Delivery, Part, Past, Rows, StoredRecords
from gateway.plugins.history.series import BEAT_S, AllSeries
from gateway.plugins.history.starts import BASELINE, MONTH, START, MotorStarts
from gateway.plugins.history.trips import MotorTrips
from gateway.plugins.history.values import MotorValues
from gateway.starters import Policy, Readings, StarterSetup
from gateway.store import RETRY_S, HistoryRow, HistoryStore, News
from gateway.system.rate_limits import ChangeDetector

log = logging.getLogger(__name__)

CLOSE_WITHIN_S = 2.0
SETTING = "setting"  # kind of the rows of settings that somebody else than the gateway has changed
SETTINGS = 100  # of each starter
KINDS = (COUNTERS, START, MONTH, BASELINE)  # that are read at the start


class MotorParts(NamedTuple):
    """The parts of one motor's history."""

    values: MotorValues
    starts: MotorStarts
    trips: MotorTrips


class History:
    """A plugin that is always there; all calls on the app's loop."""

    takes = (StateRecord, InfoRecord, EventRecord, ResultRecord, ValueRecord)

    def __init__(
        self,
        store: HistoryStore,
        setups: Iterable[StarterSetup],
        *,
        outbox: StoredRecords,
        records: RecordWriter,
        publish_event: PublishEvent,
        policy: Policy,
        traced: Sequence[str] = (),
        has_page: bool,
    ) -> None:
        """`traced` are the points whose values are stored over time; a page shows some others as well."""
        self.series = AllSeries(records, store, traced, has_page=has_page)
        self._publish_event = publish_event
        self._policy = policy
        self._store = store
        self._delivery = Delivery(records, store, outbox)
        self._recalled = asyncio.Event()
        self._ending = asyncio.Event()
        self._bugs: defaultdict[tuple[str, str], ChangeDetector] = defaultdict(ChangeDetector)
        self._unread: asyncio.Queue[tuple[str, MotorParts]] = asyncio.Queue()
        self._motors: dict[str, MotorParts] = {}
        self._add(setups)

    async def run(self) -> None:
        """Read and write the file until `end`; then end every record and write what waits."""
        self._store.start(self._on_news, self._delivery.note_stored)
        reading = asyncio.get_running_loop().create_task(self._read(), name="history")
        while not self._ending.is_set():
            self.series.beat()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._ending.wait(), BEAT_S)
        reading.cancel()
        for name in self._motors:
            self._each(name, lambda part: part.close())
        self.series.write()
        self._delivery.release()
        if not await self._store.close(within_s=CLOSE_WITHIN_S):
            log.error("the disk took too long: the latest starts and counters may be missing in the history")

    def note_left(self, keys: Sequence[str]) -> Sequence[str]:
        """Go on from what earlier runs have left in the outbox; return the keys of what must stay there."""
        self._recalled.set()
        return self._delivery.note_left(keys, self._motors)

    def end(self) -> None:
        """Have `run` end."""
        self._ending.set()

    def put(self, record: Record) -> None:
        """Record what was published of a starter."""
        if isinstance(record, ValueRecord):
            self.series.put(record)
            return
        starter = getattr(record, "starter", "")
        if isinstance(record, self.takes):
            self._each(starter, lambda part: part.put(record))
        if isinstance(record, EventRecord) and record.code == EventCode.PARAMETER_CHANGED:
            id_, data = f"{record.boot}-{record.seq}", {"time": rfc3339(record.time_s), **record.data}
            self._store.put(HistoryRow(starter, SETTING, id_, data, SETTINGS))

    def take_readings(self, starter: str, readings: Readings) -> None:
        """Record what was just read of a starter; never raises."""
        self._each(starter, lambda part: part.take_readings(readings))

    def note_fault_data(self, starter: str, at_fault: Rows, history: Sequence[Mapping[str, Any]]) -> None:
        """Record what a starter says of a trip."""
        self._each(starter, lambda part: part.note_fault_data(at_fault, history))

    def note_start_data(self, starter: str, rows: Rows) -> None:
        """Record what a starter itself has stored of a start that has just ended."""
        self._each(starter, lambda part: part.note_start_data(rows))

    def note_own_rows(self, starter: str, rows: Mapping[str, float]) -> None:
        """Record what a starter has counted itself, and its settings; by code, just read."""
        self._each(starter, lambda part: part.note_own_rows(rows))

    def reconfigure(
        self,
        setups: Iterable[StarterSetup],
        *,
        changed: Iterable[str] = (),
        traced: Sequence[str] = (),
        has_page: bool,
    ) -> None:
        """Record these starters from now on; those of `changed` are other machines, or polled otherwise."""
        wanted = {setup.name: setup for setup in setups}
        self.series.reconfigure(wanted, traced, has_page=has_page)
        for name in self._motors.keys() - wanted.keys():
            self._each(name, lambda part: part.close())
            del self._motors[name]
        self._delivery.release()  # before the broker forgets what is gone
        for setup in [wanted[name] for name in changed if name in wanted]:
            self._each(setup.name, methodcaller("reconfigure", setup))
        self._add(setup for name, setup in wanted.items() if name not in self._motors)

    def set_baseline(self, starter: str, id_: str | None, client: str) -> Mapping[str, Any]:
        """Compare later starts with this one (None: the last good one) and return it; CommandError."""
        motor = self._motors.get(starter)
        if motor is None:
            raise CommandError(ResultCode.NO_START, "none")
        return motor.starts.choose_baseline(id_, client=client)

    async def stored(self, starter: str, kinds: Sequence[str]) -> list[HistoryRow]:
        """Return what the file has of these kinds of one starter, the oldest first; StoreError."""
        return await self._store.rows(starter, kinds)

    def _add(self, setups: Iterable[StarterSetup]) -> None:
        for setup in setups:
            values = MotorValues(setup, self._delivery, self._policy)
            starts = MotorStarts(setup, self._delivery, values.put)
            motor = MotorParts(values, starts, MotorTrips(setup, self._delivery, values.put))
            self._motors[setup.name] = motor
            self._delivery.expect(setup.name)
            self._unread.put_nowait((setup.name, motor))

    def _each(self, starter: str, call: Callable[[Part], None]) -> None:
        """Call this with all parts of a motor; a bug is one part's alone, logged, the same once in a row."""
        for part in self._motors.get(starter, ()):
            try:
                call(part)
            except Exception as error:  # neither the line's nor the other parts'
                name = type(part).__name__
                if self._bugs[starter, name].is_new(repr(error)):
                    log.exception("starter=%s part=%s lost a record of the history", starter, name)

    async def _read(self) -> None:
        """Read what is stored of one motor after the other: never more than one's rows are in memory."""
        await self._recalled.wait()
        while True:
            name, motor = await self._unread.get()
            try:
                past = Past(
                    await self.stored(name, KINDS),
                    await self._delivery.take_left(name, StartRecord),
                    await self._delivery.take_left(name, TripRecord),
                )
            except StoreError as error:
                log.debug("starter=%s the history of earlier runs cannot be read: %s", name, error)
                self._unread.put_nowait((name, motor))
                await asyncio.sleep(RETRY_S)
                continue
            if motor is self._motors.get(name):  # else it is gone meanwhile
                self._each(name, methodcaller("restore", past))
                self._delivery.go_on(name)

    def _on_news(self, news: News, text: str) -> None:
        match news:
            case News.OPEN:
                log.info("history %s", text)
            case News.BACK:
                self._publish_event(EventCode.HISTORY_AVAILABLE)
            case News.AWAY:
                self._publish_event(EventCode.HISTORY_UNAVAILABLE, trouble=text)
            case News.LOST:
                self._publish_event(EventCode.HISTORY_LOST, "damaged", trouble=text)
