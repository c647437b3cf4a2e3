"""The history of all motors: fed with records and readings, it records, counts, stores and publishes.

1. Nothing here is waited for: `put` and `take_readings` return at once, and an exception stays here.
2. A motor's history begins with its configuration and goes on when its polls change; a starter that is not
   configured any more leaves memory, and its rows stay on the disk.
3. What is stored on the disk is read once at the start; of a starter that comes later, when it comes. Until
   then its starts, trips and hours are recorded without it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
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
    StartRecord,
    StateRecord,
    TripRecord,
    rfc3339,
)
from gateway.errors import StoreError
from gateway.plugins.history.delivery import Delivery, StoredRecords
from gateway.plugins.history.starts import MotorStarts
from gateway.plugins.history.trips import MotorTrips
from gateway.plugins.history.values import MotorValues
from gateway.starters.policy.policy import Policy
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.readings import Readings
from gateway.store import RETRY_S, HistoryRow, HistoryStore, News
from gateway.system.rate_limits import ChangeDetector

log = logging.getLogger(__name__)

CLOSE_WITHIN_S = 2.0
SETTING = "setting"  # kind of the rows of settings that somebody else than the gateway has changed
SETTINGS = 100  # of each starter
KINDS = (*MotorValues.kinds, *MotorStarts.kinds)


class MotorParts:
    """The parts of one motor's history; a bug in a part costs this part what it was just handed, no more."""

    def __init__(self, setup: StarterSetup, delivery: Delivery, policy: Policy) -> None:
        self.name = setup.name
        self.values = MotorValues(setup, delivery, policy)
        self.starts = MotorStarts(setup, delivery, self.values.put)
        self.trips = MotorTrips(setup, delivery, self.values.put)
        self._delivery = delivery
        self._bugs: dict[str, ChangeDetector] = {}

    def take_readings(self, readings: Readings) -> None:
        """Record what was just read."""
        for part in (self.values, self.starts, self.trips):
            self.guarded(part.take_readings, readings)

    def put(self, record: Record) -> None:
        """Record what was just published."""
        for part in (self.values, self.starts, self.trips):
            self.guarded(part.put, record)
        if isinstance(record, EventRecord) and record.code == EventCode.PARAMETER_CHANGED:
            id_, data = f"{record.boot}-{record.seq}", {"time": rfc3339(record.time_s), **record.data}
            self._delivery.store.put(HistoryRow(record.starter, SETTING, id_, data, SETTINGS))

    def restore(self, rows: Sequence[HistoryRow], left: Sequence[StartRecord | TripRecord]) -> None:
        """Go on from what earlier runs have stored, and from what they only had for the broker; once."""
        self.guarded(self.values.restore, rows)
        self.guarded(self.starts.restore, rows, [each for each in left if isinstance(each, StartRecord)])
        for record in left:
            if isinstance(record, TripRecord):
                self.guarded(self.trips.keep, record)

    def reconfigure(self, setup: StarterSetup) -> None:
        """Go on with another machine, or with other polls, under the same name: what was under way ends."""
        for part in (self.values, self.starts, self.trips):
            self.guarded(part.reconfigure, setup)

    def close(self) -> None:
        """End what is under way and store what must outlive the gateway: it ends, or the starter is gone."""
        for part in (self.values, self.starts, self.trips):
            self.guarded(part.close)

    def guarded(self, call: Callable[..., None], *what: Any) -> None:
        """Have a part do something; a bug is logged, the same one once in a row."""
        try:
            call(*what)
        except Exception as error:  # a part's bug is neither the line's nor the other parts'
            part = call.__qualname__.partition(".")[0]
            if self._bugs.setdefault(part, ChangeDetector()).is_new(repr(error)):
                log.exception("starter=%s part=%s lost a record of the history", self.name, part)


class History:
    """A plugin that is always there; all calls on the app's loop."""

    takes = (StateRecord, AvailabilityRecord, InfoRecord, EventRecord, ResultRecord)

    def __init__(
        self,
        store: HistoryStore,
        setups: Iterable[StarterSetup],
        *,
        outbox: StoredRecords,
        records: RecordWriter,
        publish_event: PublishEvent,
        policy: Policy,
    ) -> None:
        self._publish_event = publish_event
        self._policy = policy
        self._store = store
        self._delivery = Delivery(records, store, outbox)
        self._is_away = False
        self._recalled = asyncio.Event()
        self._ending = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()
        self._motors = {setup.name: self._new(setup) for setup in setups}

    async def run(self) -> None:
        """Read and write the file until `end`; then end every record and write what waits."""
        self._store.start(self._on_news, self._delivery.note_stored)
        self._load(tuple(self._motors))
        await self._ending.wait()
        for task in self._tasks:
            task.cancel()
        for motor in self._motors.values():
            motor.close()
        await self._delivery.settle()
        if not await self._store.close(within_s=CLOSE_WITHIN_S):
            log.error("the disk took too long: the latest starts and counters may be missing in the history")

    def note_left(self, keys: Sequence[str]) -> Sequence[str]:
        """Go on from what earlier runs have left in the outbox; return the keys of which it must stay there."""
        self._recalled.set()
        return self._delivery.note_left(keys, self._motors)

    def end(self) -> None:
        """Have `run` end."""
        self._ending.set()

    def put(self, record: Record) -> None:
        """Record what was published of a starter."""
        motor = self._motors.get(getattr(record, "starter", ""))
        if motor is not None and isinstance(record, self.takes):
            motor.put(record)

    def take_readings(self, starter: str, readings: Readings) -> None:
        """Record what was just read of a starter; never raises."""
        motor = self._motors.get(starter)
        if motor is not None:
            motor.take_readings(readings)

    def note_fault_data(
        self, starter: str, at_fault: Mapping[str, Mapping[str, Any]], history: Sequence[Mapping[str, Any]]
    ) -> None:
        """Record what a starter says of a trip."""
        motor = self._motors.get(starter)
        if motor is not None:
            motor.guarded(motor.trips.note_fault_data, at_fault, history)

    def note_own_rows(self, starter: str, rows: Mapping[str, float]) -> None:
        """Record what a starter has counted itself, and its settings; by code, just read."""
        motor = self._motors.get(starter)
        if motor is not None:
            motor.guarded(motor.values.note_own_rows, rows)

    def reconfigure(self, setups: Iterable[StarterSetup], *, changed: Iterable[str] = ()) -> None:
        """Record these starters from now on; those of `changed` are other machines, or polled otherwise."""
        wanted = {setup.name: setup for setup in setups}
        for name in [name for name in self._motors if name not in wanted]:
            self._motors[name].close()  # what that ends is counted while it is known
            del self._motors[name]
        self._delivery.release()  # before the broker forgets what is gone
        for name in changed:
            if name in self._motors:
                self._motors[name].reconfigure(wanted[name])
        new = {name: self._new(setup) for name, setup in wanted.items() if name not in self._motors}
        self._motors |= new
        self._load(tuple(new))

    def set_baseline(self, starter: str, id_: str | None, client: str) -> Mapping[str, Any]:
        """Compare later starts with this one (None: the last good one) and return it; CommandError."""
        motor = self._motors.get(starter)
        if motor is None:
            raise CommandError(ResultCode.NO_START, "none")
        return motor.starts.choose_baseline(id_, client=client)

    async def stored(self, starter: str, kinds: Sequence[str]) -> list[HistoryRow]:
        """Return what the file has of these kinds of one starter, the oldest first; StoreError."""
        return await self._store.rows(starter, kinds)

    def _new(self, setup: StarterSetup) -> MotorParts:
        return MotorParts(setup, self._delivery, self._policy)

    def _load(self, names: Sequence[str]) -> None:
        if names:
            task = asyncio.get_running_loop().create_task(self._restore(names), name="history")
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _restore(self, names: Sequence[str]) -> None:
        """Read one starter after the other, so that never more than one's rows are in memory."""
        await self._recalled.wait()
        for name in names:
            while (motor := self._motors.get(name)) is not None:
                try:
                    rows, left = await self.stored(name, KINDS), await self._delivery.take_left(name)
                except StoreError as error:
                    log.debug("starter=%s the history of earlier runs cannot be read: %s", name, error)
                    await asyncio.sleep(RETRY_S)
                    continue
                if motor is self._motors.get(name):  # else it is another one, which is read by itself
                    motor.restore(rows, left)
                break

    def _on_news(self, news: News, text: str) -> None:
        match news:
            case News.OPEN:
                log.info("history %s", text)
                if self._is_away:
                    self._publish_event(EventCode.HISTORY_AVAILABLE)
                self._is_away = False
            case News.AWAY:
                self._is_away = True
                self._publish_event(EventCode.HISTORY_UNAVAILABLE, trouble=text)
            case News.LOST:
                self._publish_event(EventCode.HISTORY_LOST, trouble=text)
