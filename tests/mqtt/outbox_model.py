"""The outbox against an oracle: chance puts, sends, and loses connections, disks and processes.

Nothing here waits: the disk is SQLite in memory, and what a thread does has three moments (asked for, done,
reported), between which anything else may happen. A crash forgets everything but the table.
"""

from __future__ import annotations

import json
import random
import sqlite3
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from typing import Any, ClassVar
from unittest.mock import patch

from gateway.contract import Event, EventCode, EventRecord, Phase, Quality, ResultRecord, ValueRecord
from gateway.mqtt.message import Message, message_of
from gateway.mqtt.outbox import backlog
from gateway.mqtt.outbox.backlog import Batch, Bounds
from gateway.mqtt.outbox.outbox import HELD_AFTER_S, Outbox, Outgoing
from gateway.store import OutboxRow, OutboxTable, Rank
from gateway.store.schema import STATE

STARTERS, POINTS = 3, 4
MS = 0.0011  # to which times are published
EVENT = EventRecord(starter="p", seq=1, time_s=0.0, code=EventCode.GAP, severity="info", text="")
RESULT = ResultRecord(
    starter="p", client="alice", id="1", verb="stop", phase=Phase.CONFIRMED, code="ok", text="", time_s=0.0
)
REPLY = replace(RESULT, phase=Phase.ACCEPTED)  # no final one, which may come again
KIND = {Rank.VALUE: "value", Rank.EVENT: "event", Rank.RESULT: "result"}


@dataclass(frozen=True)
class Trouble:
    """What may happen besides puts and sends, and the bounds."""

    WIDE: ClassVar = (20_000, 400_000, 48 * 2**20)

    crashes: bool = True
    disk_fails: bool = False
    table_is_lost: bool = False
    max_rows: int = 20_000
    most_rows: int = 400_000
    most_bytes: int = 48 * 2**20

    @property
    def is_bounded(self) -> bool:
        """Return whether there is less room than messages."""
        return (self.max_rows, self.most_rows, self.most_bytes) != Trouble.WIDE


TROUBLES = (
    Trouble(),
    Trouble(disk_fails=True),
    Trouble(crashes=False, most_rows=300),
    Trouble(most_bytes=60_000),
    Trouble(crashes=False, disk_fails=True, max_rows=120),
    Trouble(disk_fails=True, max_rows=150, most_rows=200),
    Trouble(crashes=False, table_is_lost=True),
)


@dataclass
class Oracle:
    """What was put, what the broker had, and what may be missing or come twice."""

    kinds: dict[int, str] = field(default_factory=dict)
    put_s: dict[int, float] = field(default_factory=dict)
    starters: dict[int, int] = field(default_factory=dict)  # of values
    displaced: set[int] = field(default_factory=set)  # whose place is not that of their put
    received: dict[int, int] = field(default_factory=dict)  # how often, live ones once
    order: list[tuple[str, int]] = field(default_factory=list)  # of first receptions of rows
    excused: set[int] = field(default_factory=set)  # not stored when the process died, and too young for it
    doubtful: set[int] = field(
        default_factory=set
    )  # received, which the gateway did not know when it mattered
    again: Counter[str] = field(default_factory=Counter)  # declared, and the table did not know it at a crash
    gaps: dict[int, list[dict[str, Any]]] = field(default_factory=dict)  # by the number of the event

    def receive(self, number: int, group: str) -> None:
        """Note that the broker has a row."""
        self.received[number] = self.received.get(number, 0) + 1
        if self.received[number] == 1 and number not in self.displaced:
            self.order.append((group, number))
        assert self.received[number] == 1 or number in self.doubtful, f"{number} came twice"

    def check(self, *, is_ordered: bool) -> None:
        """Everything came, or was declared by kind and time, no more than that, and in order."""
        missing = self.kinds.keys() - self.received.keys()
        lost = [each for gap in self.gaps.values() for each in gap]
        for kind in KIND.values():
            declared = sum(each["count"] for each in lost if each["kind"] == kind)
            sure = {number for number in missing - self.excused if self.kinds[number] == kind}
            possible = {number for number in missing | self.doubtful if self.kinds[number] == kind}
            most = len(possible) + self.again[kind]
            assert len(sure) <= declared <= most, (kind, len(sure), declared, most)
            spans = [(each["first"], each["last"]) for each in lost if each["kind"] == kind]
            for number in sure:
                time_s = self.put_s[number]
                assert any(first - MS <= time_s <= last + MS for first, last in spans), (kind, number, time_s)
        if is_ordered:
            last: dict[str, int] = {}
            for group, number in self.order:
                assert last.get(group, -1) < number, (group, last[group], number)
                last[group] = number


class Model:
    """A gateway's outbox, its disk and its broker."""

    def __init__(self, seed: int, trouble: Trouble) -> None:
        self.dice = random.Random(seed)
        self.trouble = trouble
        self.oracle = Oracle()
        self.now_s = 0.0
        self.numbers = self.puts = self.lives = 0
        self.pace = 1.0  # of the broker
        self.looked_s = 0.0  # up to here all is stored that must be
        self.is_disk_well = True
        self.disk = self._new_disk()
        self.released_s: dict[int, float] = {}  # what was staged before
        self.stored: set[int] = set()  # what the table has or had
        self._begin()

    def _begin(self) -> None:
        """Begin a run on what the disk has."""
        self.lives += 1
        self.outbox = Outbox(
            last_topic="b/gateway/status",
            boot=f"run {self.lives}",
            memory=Bounds(self.trouble.max_rows, 16 * 2**20),
            table=Bounds(self.trouble.most_rows, self.trouble.most_bytes),
        )
        self.backlog = self.outbox.backlog
        self.backlog.expect_table()
        self.is_unreadable = False
        self.backlog.is_table_away = lambda: self.is_unreadable
        self.table = OutboxTable()
        self.is_recalled = self.is_connected = False
        self.wire: list[tuple[Outgoing, bool]] = []  # with whether the broker has it
        self.deletable: set[int] = set()  # acknowledged, and perhaps still in the table
        self.staged: dict[int, Message] = {}
        self.storing: list[OutboxRow] = []  # of them, with their commands, in transactions of their own
        self.under_way = Batch()  # what the disk is writing
        self.disk_work = self._disk_work()

    # The plant.

    def put(self) -> None:
        """Put a message of some kind."""
        self.puts += 1
        self.now_s += 0.01
        match self.dice.randrange(10):
            case 0 | 1 | 2:
                self._put_row("event", is_droppable=True)
            case 3:
                self._put_row("result", is_droppable=False)
            case 4:
                self._stage()
            case _:
                self._put_value()

    def _number(self, kind: str) -> int:
        self.numbers += 1
        self.oracle.kinds[self.numbers] = kind
        self.oracle.put_s[self.numbers] = self.now_s
        return self.numbers

    def _put_row(self, kind: str, *, is_droppable: bool) -> int:
        number = self._number(kind)
        self.outbox.put(queued("b/x", f"{number}", sort=EVENT if is_droppable else REPLY), self.now_s)
        return number

    def _stage(self) -> None:
        number = self._number("result")
        self.oracle.displaced.add(number)
        message = queued("b/x", f"{number}", sort=RESULT)
        row = self.outbox.stage(message, self.now_s)
        self.staged[number] = message
        self.storing.append(row)

    def _store_staged(self) -> None:
        """Let the disk have one of the results that are staged, or were: a stop's is published at once."""
        row = self.storing.pop()
        if self.is_disk_well and self.backlog.is_to_be_stored(row):
            self._transact(lambda connection: self.table.insert(connection, [row]))

    def _put_value(self) -> None:
        number = self._number("value")
        starter = self.dice.randrange(STARTERS)
        self.oracle.starters[number] = starter
        record = ValueRecord(
            starter=f"s{starter}", point=f"p{self.dice.randrange(POINTS)}", value=1.0, unit="A",
            quality=Quality.GOOD, time_s=0.0, seq=number,
        )  # fmt: skip
        self.outbox.put(message_of(record, "b"), self.now_s)

    # The broker.

    def send(self) -> None:
        """Have something sent, which reaches the broker now or later."""
        for _ in range(self.dice.randrange(12)):
            outgoing = self.outbox.take()
            if outgoing is None:
                return
            self.wire.append((outgoing, False))

    def receive(self) -> None:
        """Let the broker have some of what is under way, in order."""
        count = self.dice.randrange(len(self.wire) + 1)
        for place, (outgoing, is_received) in enumerate(self.wire[:count]):
            if not is_received:
                self._receive(outgoing)
                self.wire[place] = (outgoing, True)

    def _receive(self, outgoing: Outgoing) -> None:
        for row in outgoing.rows:
            if row.rank is Rank.VALUE:
                number = int(json.loads(row.payload)["seq"])
                self.oracle.receive(number, f"history {self.oracle.starters[number]}")
            else:
                self.oracle.receive(int(row.payload), KIND[row.rank])
        for number in _live(outgoing):
            self.oracle.received.setdefault(number, 1)

    def acknowledge(self) -> None:
        """Let some acknowledgements of what the broker has come, a few of them refusals."""
        arrived = [outgoing for outgoing, is_received in self.wire if is_received]
        for outgoing in arrived[: self.dice.randrange(len(arrived) + 1)]:
            self.wire = [each for each in self.wire if each[0] is not outgoing]
            self.deletable |= set(_numbers(outgoing))
            self.outbox.acked(outgoing.ticket, 0x87 if self.dice.random() < 0.01 else 0)

    def lose_connection(self) -> None:
        """Lose what is under way, but for a first part that the broker has already."""
        if self.is_connected:
            self._note_doubtful()
            self.wire.clear()
            self.outbox.disconnected()
            self.is_connected = False

    def connect(self) -> None:
        if not self.is_connected:
            self.is_connected = True
            self.outbox.connected(self.dice.choice((1, 5, 20, 100)))
            self.outbox.grant_history(10**6)

    def _note_doubtful(self) -> None:
        for outgoing, is_received in self.wire:
            if is_received:
                self.oracle.doubtful |= set(_numbers(outgoing))

    # The disk.

    def _new_disk(self) -> sqlite3.Connection:
        disk = sqlite3.connect(":memory:", isolation_level=None)
        for step in STATE.steps:
            step(disk)
        return disk

    def _transact(self, work: Callable[[sqlite3.Connection], Any]) -> Any:
        self.disk.execute("BEGIN")
        try:
            answer = work(self.disk)
        except BaseException:
            self.disk.execute("ROLLBACK")
            raise
        self.disk.execute("COMMIT")
        return answer

    def _disk_work(self) -> Iterator[bool]:
        """Have the disk read and write; yield between the moments, with whether there was nothing to do."""
        while True:
            self.outbox.hold_slow(self.now_s)
            if self.is_connected and (gap := self.backlog.losses.declare(self.now_s)) is not None:
                self.oracle.gaps[self._put_row("event", is_droppable=True)] = gap_of(gap)
            wanted = self.backlog.wanted(is_sending=self.is_connected)
            if not self.is_recalled:
                found = yield from self._read(lambda c: (self.table.totals(c), self.table.losses(c)))
                if found is not None:
                    self.backlog.recall(*found)
                    self.is_recalled = True
            elif wanted and self.dice.random() < 0.7:
                rank, after = self.dice.choice(wanted)
                page = yield from self._read(partial(self.table.page, rank=rank, after=after, limit=7))
                if page is not None:
                    self.backlog.page(rank, page)
            elif (batch := self.backlog.batch()) is not None:
                self.under_way = batch
                yield False
                self._lose_table_perhaps()
                is_done = self._write(batch)
                yield False
                (self.backlog.written if is_done else self.backlog.unwritten)(batch)
                self.under_way = Batch()
            else:
                yield True

    def _read(self, work: Callable[[sqlite3.Connection], Any]) -> Generator[bool, None, Any]:
        """Return what the disk says, or None: it is asked for, done and reported in three moments."""
        yield False
        self._lose_table_perhaps()
        answer = self._transact(work) if self.is_disk_well else None
        yield False
        self.is_unreadable = answer is None
        return answer

    def _lose_table_perhaps(self) -> None:
        if self.trouble.table_is_lost and self.dice.random() < 0.002:
            self.disk = self._new_disk()
            self.backlog.lose_table()

    def _write(self, batch: Batch) -> bool:
        """Write it, and return whether that is said to be done; a full disk takes what deletes."""
        is_done = is_said = True
        if not self.is_disk_well:
            is_said = not batch.rows and self.dice.random() < 0.3
            is_done = is_said or self.dice.random() < 0.1
        if is_done:
            self._transact(partial(self._store, batch))
            self.stored |= {_number_of(row.payload) for row in batch.rows}
        return is_said

    def _store(self, batch: Batch, connection: sqlite3.Connection) -> None:
        self.table.delete(connection, ((rank, id_) for id_, rank in batch.gone.items()))
        self.table.insert(connection, batch.rows)
        if batch.losses is not None:
            self.table.set_losses(connection, batch.losses)

    def crash(self) -> None:
        """End the process: what must have been stored is, all else is excused."""
        self._note_doubtful()
        rows = dict(self.disk.execute("SELECT id, payload FROM outbox"))
        stored = {_number_of(payload) for payload in rows.values()}
        oracle = self.oracle
        gone = {*self.backlog._gone, *self.under_way.gone}
        base = self.table._earlier or 0
        # Given up and not deleted: it comes after all, later than what came after it.
        oracle.displaced |= {_number_of(rows[id_ + base]) for id_ in gone if id_ + base in rows}
        oracle.doubtful |= self.deletable & stored
        for loss in self.table.losses(self.disk):
            oracle.again[KIND[loss.rank]] += loss.rows
        for loss in self.backlog.losses.pending:
            oracle.again[KIND[loss.rank]] -= min(loss.rows, oracle.again[KIND[loss.rank]])
        unstored = oracle.kinds.keys() - stored - oracle.received.keys()
        unstored -= self.stored
        waiting = {_number_of(row.payload) for row in self.backlog._rows.values()}
        for number in self.oracle.gaps.keys() & waiting & unstored:
            del self.oracle.gaps[number]  # it is declared again
        oracle.excused |= {each for each in unstored if self._is_young(each) or each in self.staged}
        self._begin()

    def _is_young(self, number: int) -> bool:
        """Return whether a message need not have been stored yet: no look of the disk since it was put."""
        put_s = self.released_s.get(number, self.oracle.put_s[number])
        return put_s >= self.looked_s - (HELD_AFTER_S if self.oracle.kinds[number] == "value" else 0.0)

    def settle(self) -> None:
        """Let the disk do all that waits, as far as it can."""
        while self.is_disk_well:
            if next(self.disk_work):
                self.looked_s = self.now_s
                return

    # All of it.

    def step(self) -> None:
        self.put()
        self._release_staged()
        if self.is_connected:
            for action in (self.send, self.receive, self.acknowledge):
                if self.dice.random() < self.pace:
                    action()
        for _ in range(self.dice.randrange(3)):
            next(self.disk_work)
        if self.storing and self.dice.random() < 0.3:
            self._store_staged()
        chance = self.dice.random()
        if chance < 0.01:
            self.now_s += 2.0
            self.settle()
        elif chance < 0.014:
            self.pace = self.dice.choice((0.0, 0.2, 1.0, 1.0))  # the broker stands still, is slow, or quick
        elif chance < 0.024:
            self.connect()
        elif chance < 0.029:
            self.lose_connection()
        elif chance < 0.031 and self.trouble.crashes:
            self.crash()
        elif chance < 0.034 and self.trouble.disk_fails:
            self.is_disk_well = not self.is_disk_well

    def _release_staged(self) -> None:
        for number in [number for number in self.staged if self.dice.random() < 0.3]:
            self.outbox.put(self.staged.pop(number), self.now_s)
            self.released_s[number] = self.now_s

    def end(self) -> None:
        """Let everything come that will ever come."""
        self.is_disk_well = True
        for number in list(self.staged):
            self.outbox.put(self.staged.pop(number), self.now_s)
        self.pace = 1.0
        for _ in range(200_000):
            self.connect()
            self.send()
            self.receive()
            self.acknowledge()
            self.now_s += 1.0
            is_over = next(self.disk_work) and self.outbox.is_idle and not self.wire
            if is_over and not self.backlog.losses.pending:
                return
        raise AssertionError(f"it never ends: {self.outbox.statistics(self.now_s)}")


def gap_of(event: Event) -> list[dict[str, Any]]:
    """Return what an event declares lost, with times in seconds."""
    return [
        {**each, **{name: datetime.fromisoformat(each[name]).timestamp() for name in ("first", "last")}}
        for each in event.data["lost"]
    ]


def queued(topic: str, text: str, *, sort: ResultRecord | EventRecord) -> Message:
    """Return a message like those of a record, with another payload; a final result has its text as id."""
    record = replace(sort, id=text) if isinstance(sort, ResultRecord) else sort
    return Message(topic, text.encode(), qos=1, retain=False, record=record)


def _number_of(payload: bytes) -> int:
    return int(json.loads(payload)["seq"]) if payload.startswith(b"{") else int(payload)


def _numbers(outgoing: Outgoing) -> Iterable[int]:
    yield from (_number_of(row.payload) for row in outgoing.rows)
    yield from _live(outgoing)


def _live(outgoing: Outgoing) -> Iterable[int]:
    record = outgoing.message.record
    return [record.seq] if isinstance(record, ValueRecord) else []


def run(seed: int, messages: int, trouble: Trouble) -> Counter[str]:
    """Run one model and check it; return what happened, for people."""
    with (
        patch.dict(backlog.WINDOWS, dict.fromkeys(Rank, 8)),
        patch.multiple(backlog, MOST_VALUES=5, MOST_ROWS=7),
    ):
        model = Model(seed, trouble)
        while model.puts < messages:
            model.step()
        model.end()
    oracle = model.oracle
    oracle.check(is_ordered=not trouble.disk_fails)
    return Counter(
        put=len(oracle.kinds),
        received=len(oracle.received),
        twice=sum(count > 1 for count in oracle.received.values()),
        declared=sum(each["count"] for gap in oracle.gaps.values() for each in gap),
        excused=len(oracle.excused - oracle.received.keys()),
        runs=model.lives,
    )
