"""Records the starts of analytic motors as fast as it can, and names each that is stored: to be killed."""

from __future__ import annotations

import asyncio
import itertools
import os
import sys
from functools import partial
from pathlib import Path

from gateway.config.convert import policy_of, rights_of, setups_of
from gateway.config.reading import parse
from gateway.contract import EventRecord, Record, RecordWriter, Sink, StartRecord, Topics
from gateway.mqtt import DiskSync, Outbox, Publisher, message_of
from gateway.plugins.history.delivery import StoredRecords
from gateway.plugins.history.plugin import History
from gateway.starters import Policy, Readings, Tokens
from gateway.store import HISTORY_FILE, STATE_FILE, Documents, HistoryStore, OutboxTable, Store
from gateway.store.schema import STATE
from gateway.system.clock import SystemClock
from gateway.system.supervised import on_this_loop
from tests.history.support import AnalyticStart, ReadMotor
from tests.rig.sites import line, starter, table

STARTERS = ("pump", "fan")
SITE = (
    table("gateway", name="plant")
    + table("mqtt", url="mqtt://127.0.0.1")
    + line()
    + "".join(starter(name, address, "ssw07") for address, name in enumerate(STARTERS, 1))
)


class Stored:
    """A sink that has the names of starts as soon as they are published, and hands records on."""

    def __init__(self) -> None:
        self.published: asyncio.Queue[str] = asyncio.Queue()
        self.others: list[Sink] = []

    def put(self, record: Record) -> None:
        for other in self.others:
            other.put(record)
        if isinstance(record, StartRecord):
            self.published.put_nowait(f"{record.starter} {record.id}\n")
        if isinstance(record, EventRecord):
            os.write(1, f"{record.code}: {record.text}\n".encode())


def replies(number: int) -> list[Readings]:
    """Return the replies of one start, the whole of it within virtual time."""
    begin_s = 60.0 * number + 10.0
    motor = ReadMotor(AnalyticStart(begin_s, 3.0), seed=number, is_ours=True)
    return list(motor.replies(60.0 * number, begin_s + 12.0))


async def write(folder: Path, run: str) -> None:
    """Record start after start, without end and without a broker; one is named once the file has it."""
    sink, clock = Stored(), SystemClock()
    config = parse(SITE, "site.toml")
    setups = [setup for line in config.lines for setup in setups_of(line)]
    records = RecordWriter(sink, clock, boot=run)
    publish_event = partial(records.event, "")
    store, topics = Store(folder / STATE_FILE, STATE), Topics("plant")
    outbox = Outbox(last_topic="", boot=run, utc_of=clock.utc_s)
    publisher = Publisher(topics, Tokens(run), outbox, sink=sink, clock=clock)
    disk_sync = DiskSync(
        outbox, store, OutboxTable(), clock=clock, publish_event=publish_event, wake=publisher.wake
    )
    history = History(
        HistoryStore(folder / HISTORY_FILE),
        setups,
        outbox=StoredRecords(
            keep=lambda record: disk_sync.keep(message_of(record, topics.base)),
            payloads=disk_sync.payloads,
            let_go=disk_sync.let_go,
        ),
        records=records,
        policy=Policy(
            policy_of(config), STARTERS, rights=rights_of(config), records=records, documents=Documents()
        ),
        publish_event=publish_event,
    )
    sink.others += [history, publisher]
    disk_sync.on_recalled = history.note_left
    store.start(on_this_loop(disk_sync.note_news))
    running = [asyncio.create_task(each) for each in (disk_sync.run(), history.run())]
    await asyncio.sleep(0)  # they begin
    for number in itertools.count():
        assert not any(task.done() for task in running)
        starter = STARTERS[number % len(STARTERS)]
        for readings in replies(number // len(STARTERS)):
            history.take_readings(starter, readings)
        name = await sink.published.get()
        await history.stored("", ())  # what was put up to now is on the disk
        os.write(1, name.encode())  # one piece that no kill can cut


if __name__ == "__main__":
    asyncio.run(write(Path(sys.argv[1]), sys.argv[2]))
