"""What is stored of the counters, run after run: kills, orderly ends, a disk that was away."""

import random
from collections.abc import Sequence
from typing import Any

from gateway.app.history.counters import CountersPart
from gateway.app.history.part import Surroundings
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.history.readings import Readings
from gateway.records import Quality, RecordWriter, StartRecord
from gateway.starters.setup import StarterSetup
from gateway.storage.history_table import HistoryRow
from gateway.system.clock_steps import ClockReading
from tests.history.memory_file import MemoryFile
from tests.starters.fakes import RecordingSink

SETUP = StarterSetup("pump", "pumps", 1, load_profile("ssw07"), Variant())


class Disk(MemoryFile):
    """A file that counts how often it is written."""

    def __init__(self) -> None:
        super().__init__()
        self.writes = 0

    def put(self, *names: Any, **row: Any) -> None:
        self.writes += 1
        super().put(*names, **row)

    @property
    def counters(self) -> list[HistoryRow]:
        return list(self.rows.values())

    @property
    def operating_s(self) -> float:
        return sum(float(row.data["totals"]["operating_s"]) for row in self.counters)


class Time:
    """The clocks, which go on from run to run."""

    def __init__(self) -> None:
        self.at_s = 0.0

    def now_s(self) -> float:
        return self.at_s

    def utc_s(self, at_s: float | None = None) -> float:
        return 1.7e9 + (self.at_s if at_s is None else at_s)

    def reading(self) -> ClockReading:
        return ClockReading(self.at_s, self.utc_s(), "boot")


class Run:
    """One run of the gateway with its part, fed by hand; `rows` None: the disk has not been read."""

    def __init__(self, disk: Disk, time: Time, boot: str, *, rows: Sequence[HistoryRow] | None) -> None:
        self.time, self.sink = time, RecordingSink()
        here = Surroundings(boot, RecordWriter(self.sink, time), disk)
        self.part = CountersPart(SETUP, here)
        if rows is not None:
            self.part.restore(rows)

    def operate(self, seconds: int, state: str = "running", *, every_s: int = 1) -> None:
        for _ in range(seconds // every_s):
            self.time.at_s += every_s
            values = {"running": state == "running", "current_pct": 80.0}
            self.part.take_readings(Readings(self.time.at_s, self.time.utc_s(), state, values))

    def start(self) -> None:
        self.part.take_record(StartRecord("pump", "boot-1", {}))


def test_many_kills_lose_at_most_ten_minutes_each() -> None:
    chance, disk, time = random.Random(15), Disk(), Time()
    for run in range(30):
        before_s, seconds = disk.operating_s, chance.randrange(1, 4000)
        Run(disk, time, f"boot-{run}", rows=disk.counters).operate(seconds)  # and nothing more: killed

        assert before_s + seconds - 600 <= disk.operating_s <= before_s + seconds


def test_counting_writes_every_ten_minutes() -> None:
    disk = Disk()
    Run(disk, Time(), "boot-1", rows=[]).operate(86_400, every_s=10)

    assert 140 <= disk.writes <= 150
    assert len(disk.rows) == 1


def test_a_motor_that_stands_still_writes_once_a_day_and_at_an_orderly_end() -> None:
    disk, time = Disk(), Time()
    run = Run(disk, time, "boot-1", rows=[])
    run.operate(600)
    run.operate(2 * 86_400 + 3600, "ready", every_s=10)

    assert disk.writes == 1 + 1 + 2  # while it ran, what came after that, and each day

    run.part.close()

    assert disk.writes == 5
    assert disk.operating_s >= 598


def test_an_orderly_end_loses_nothing() -> None:
    disk, time = Disk(), Time()
    first = Run(disk, time, "boot-1", rows=[])
    first.start()
    first.operate(500)
    first.part.close()

    again = Run(disk, time, "boot-2", rows=disk.counters)
    again.operate(10, "ready")

    assert again.sink.values("starts_total")[-1].value == 1
    assert again.sink.values("hours_total")[-1].value == round(499 / 3600, 3)


def test_before_the_disk_is_read_nothing_is_good_and_nothing_is_stored() -> None:
    disk = Disk()
    run = Run(disk, Time(), "boot-1", rows=None)
    run.start()
    run.operate(1000)
    run.part.close()

    assert {each.quality for each in run.sink.values("hours_total")} == {Quality.BAD}
    assert disk.counters == []


def test_what_was_counted_before_the_disk_was_read_counts() -> None:
    disk, time = Disk(), Time()
    run = Run(disk, time, "boot-1", rows=None)
    run.operate(101)
    run.part.restore([HistoryRow("pump", "counters", "b", 0.0, {"totals": {"operating_s": 50.0}})])
    run.part.close()

    assert disk.operating_s == 150.0


def test_a_run_that_could_not_read_the_disk_takes_nothing_away() -> None:
    disk, time = Disk(), Time()
    for boot in ("boot-1", "boot-2"):  # the second one finds the disk away
        run = Run(disk, time, boot, rows=[])
        run.start()
        run.part.close()
    assert len(disk.rows) == 2

    for boot in ("boot-3", "boot-4"):
        run = Run(disk, time, boot, rows=disk.counters)
        run.operate(2, "ready")
        assert run.sink.values("starts_total")[-1].value == 2
        run.part.close()
        assert len(disk.rows) == 1


def test_another_configuration_of_the_starter_goes_on_counting() -> None:
    disk, time = Disk(), Time()
    run = Run(disk, time, "boot-1", rows=[])
    run.operate(101)
    run.part.follow(SETUP)
    run.operate(101)
    run.part.close()

    assert disk.operating_s == 200.0
