"""Records the starts of analytic motors as fast as it can, and names each that is stored: to be killed."""

from __future__ import annotations

import asyncio
import itertools
import os
import sys
from functools import partial
from pathlib import Path

from gateway.config.convert import policy_of, rights_of, setups_of
from gateway.config.load import parse
from gateway.contract import EventRecord, Record, RecordWriter, StartRecord
from gateway.plugins.history.plugin import History
from gateway.starters.policy.policy import Policy
from gateway.starters.telemetry.readings import Readings
from gateway.system.clock import SystemClock
from tests.history.support import AnalyticStart, ReadMotor
from tests.small_site import small_site

STARTERS = ("pump", "fan")
SITE = small_site(*((name, "ssw07") for name in STARTERS))


class Stored:
    """A sink that has the names of starts as soon as they are published, and hands records to the history."""

    def __init__(self) -> None:
        self.published: list[tuple[str, str]] = []  # and not named yet
        self.history: History | None = None

    def put(self, record: Record) -> None:
        if self.history is not None:
            self.history.put(record)
        if isinstance(record, StartRecord):
            self.published.append((record.starter, record.id))
        if isinstance(record, EventRecord):
            os.write(1, f"{record.code}: {record.text}\n".encode())


def replies(number: int) -> list[Readings]:
    """Return the replies of one start, the whole of it within virtual time."""
    begin_s = 60.0 * number + 10.0
    motor = ReadMotor(AnalyticStart(begin_s, 3.0), seed=number, is_ours=True)
    return list(motor.replies(60.0 * number, begin_s + 12.0))


async def write(folder: Path, run: str) -> None:
    """Record start after start, without end; one is named once the file has it."""
    sink = Stored()
    config = parse(SITE, "site.toml")
    setups = [setup for line in config.lines for setup in setups_of(line)]

    records = RecordWriter(sink, SystemClock(), boot=run)
    history = History(
        folder,
        setups,
        records=records,
        policy=Policy(policy_of(config), STARTERS, rights=rights_of(config), records=records),
        publish_event=partial(records.event, ""),
    )
    sink.history = history
    running = asyncio.create_task(history.run())
    await asyncio.sleep(0)  # it begins
    for number in itertools.count():
        assert not running.done()
        starter = STARTERS[number % len(STARTERS)]
        for readings in replies(number // len(STARTERS)):
            history.take_readings(starter, readings)
        await history.stored("", ())  # what was put up to now is on the disk
        lines = [f"{starter} {id_}\n" for starter, id_ in sink.published]
        os.write(1, "".join(lines).encode())  # one piece that no kill can cut
        sink.published.clear()


if __name__ == "__main__":
    asyncio.run(write(Path(sys.argv[1]), sys.argv[2]))
