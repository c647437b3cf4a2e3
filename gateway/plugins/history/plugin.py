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
    StartRecord,
    StateRecord,
    TripRecord,
    rfc3339,
)
from gateway.errors import StoreError
from gateway.plugins.history.delivery import UNDELIVERED, Delivery, PublishAgain
from gateway.plugins.history.starts import MotorStarts
from gateway.plugins.history.trips import MotorTrips
from gateway.plugins.history.values import MotorValues
from gateway.starters.policy.policy import Policy
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.readings import Readings
from gateway.storage.history import HistoryStore
from gateway.storage.history_table import HistoryRow
from gateway.store import News, OnNews
from gateway.system.rate_limits import ChangeDetector

log = logging.getLogger(__name__)

CLOSE_WITHIN_S = 2.0
SETTING = "setting"  # kind of the rows of settings that somebody else than the gateway has changed
SETTINGS = 100  # of each starter
KINDS = (UNDELIVERED, *MotorValues.kinds, *MotorStarts.kinds)


class MotorParts:
    """The parts of one motor's history; a bug in a part costs this part what it was just handed, no more."""

    def __init__(self, setup: StarterSetup, delivery: Delivery, policy: Policy) -> None:
        self.name = setup.name
        self.is_unread = False  # its rows could not be read
        self.values = MotorValues(setup, delivery, policy)
        self.starts = MotorStarts(setup, delivery)
        self.trips = MotorTrips(setup, delivery)
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
            self._delivery.store(record.starter, SETTING, id_, data, limit=SETTINGS)

    def restore(self, rows: Sequence[HistoryRow] | None) -> None:
        """Go on from what earlier runs have stored; None: it cannot be read yet."""
        if rows is None and self.is_unread:
            return
        self.is_unread = rows is None
        for part in (self.values, self.starts):  # the starts that this ends are counted
            self.guarded(part.restore, rows)

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
        state_dir: Path,
        setups: Iterable[StarterSetup],
        *,
        records: RecordWriter,
        publish_event: PublishEvent,
        policy: Policy,
        publish_again: PublishAgain = lambda _: None,
        make_file: Callable[[Path, OnNews], HistoryStore] = HistoryStore,
    ) -> None:
        self._publish_event = publish_event
        self._policy = policy
        self._store = make_file(state_dir, self._on_news)
        self._delivery = Delivery(records, self._store, count=self._count, publish_again=publish_again)
        self.delivered = self._delivery.delivered  # called with the key of what the broker has acknowledged
        self._is_away = False
        self._ending = asyncio.Event()
        self._motors = {setup.name: self._new(setup) for setup in setups}

    async def run(self) -> None:
        """Read and write the file until `end`; then end every record and write what waits."""
        self._store.start()
        self._load(tuple(self._motors))
        await self._ending.wait()
        self._delivery.close()
        for motor in self._motors.values():
            motor.close()
        if not await self._store.close(within_s=CLOSE_WITHIN_S):
            log.error("the disk took too long: the latest starts and counters may be missing in the history")
        self._delivery.release()

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
        return (await self._store.load([starter], kinds)).get(starter, [])

    def _new(self, setup: StarterSetup) -> MotorParts:
        return MotorParts(setup, self._delivery, self._policy)

    def _count(self, record: StartRecord | TripRecord) -> None:
        motor = self._motors[record.starter]
        motor.guarded(motor.values.put, record)

    def _load(self, names: Sequence[str]) -> None:
        if names:
            self._delivery.begin(self._restore(names))

    async def _restore(self, names: Sequence[str]) -> None:
        """Read one starter after the other, so that never more than one's rows are in memory."""
        for name in names:
            motor, rows = self._motors.get(name), None
            try:
                rows = await self.stored(name, KINDS)
            except StoreError as error:
                log.warning("starter=%s the history of earlier runs cannot be read: %s", name, error)
            if motor is not None and motor is self._motors.get(name):  # else it is gone meanwhile
                motor.restore(rows)
                self._delivery.publish_left(name, rows or ())

    def _on_news(self, news: News, text: str) -> None:
        match news:
            case News.OPEN:
                log.info("history %s", text)
                if self._is_away:
                    self._publish_event(EventCode.HISTORY_AVAILABLE)
                self._is_away = False
                self._load(tuple(name for name, motor in self._motors.items() if motor.is_unread))
            case News.AWAY:
                self._is_away = True
                self._publish_event(EventCode.HISTORY_UNAVAILABLE, trouble=text)
            case News.LOST:
                self._publish_event(EventCode.HISTORY_LOST, trouble=text)
