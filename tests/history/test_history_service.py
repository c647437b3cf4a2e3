"""The history of a plant's starters, from the wire to the records; in virtual time, on simulated lines."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from gateway.app.history import HistoryService
from gateway.app.history.part import Surroundings
from gateway.app.history.service import StarterHistory
from gateway.app.history.starts import StartHistory
from gateway.history.start_recorder import StartPoints
from gateway.records import (
    AlarmRecord,
    EventRecord,
    RecordWriter,
    Severity,
    StartRecord,
)
from gateway.storage.history import HistoryStore, read_history
from gateway.system.clock import SystemClock
from tests.history.memory_file import MemoryFile
from tests.history.support import AnalyticStart, ReadMotor
from tests.plant_rig import setups, site
from tests.starters.fakes import RecordingSink
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock


class Starts:
    """One starter's starts without a line: fed with the replies of analytic motors."""

    def __init__(self, file: MemoryFile | None = None) -> None:
        clock = VirtualClock(asyncio.get_running_loop())
        self.file = file or MemoryFile()
        self.sink = RecordingSink()
        here = Surroundings("boot", RecordWriter(self.sink, clock), self.file)
        (setup, *_) = setups(site())
        self.part = StartHistory(setup, here)
        self.history = StarterHistory(setup.name, [self.part])
        self.now_s = 0.0

    async def restore(self) -> None:
        rows = await self.file.load([self.history.name])
        self.history.each(lambda part: part.restore(rows.get(self.history.name, [])))

    async def start(self, ramp_s: float = 8.0, *, seed: int = 0) -> None:
        """Let the motor stand, start and stop."""
        begin_s = self.now_s + 20.0
        motor = ReadMotor(AnalyticStart(begin_s, ramp_s), seed=seed, is_ours=True)
        for readings in motor.replies(self.now_s, begin_s + ramp_s + 7.0):
            self.history.each(lambda part, readings=readings: part.take_readings(readings))  # type: ignore[misc]
        self.now_s = begin_s + ramp_s + 100.0
        await asyncio.sleep(0)

    def events(self) -> list[str]:
        return [record.code for record in self.sink.of(EventRecord)]

    def alarms(self) -> list[bool]:
        return [record.is_active for record in self.sink.of(AlarmRecord)]


@virtually
async def test_a_start_that_is_over_before_the_file_was_read_is_not_lost() -> None:
    here = Starts()
    await here.start()
    assert here.sink.of(StartRecord) == []

    await here.restore()

    assert len(here.sink.of(StartRecord)) == 1
    assert len(here.file.of("pump", "start")) == 1


@virtually
async def test_rows_that_cannot_be_read_cost_only_what_they_held() -> None:
    here = Starts()
    await here.restore()
    for number in range(7):
        await here.start(seed=number)
    ids = [row["id"] for row in here.file.of("pump", "start")]
    for kind, id_ in (("start", ids[6]), ("baseline", "baseline"), ("month", "2025-10")):
        for key in [key for key in here.file.rows if key[1] == kind and id_ in (key[2], "2025-10")]:
            here.file.rows[key] = here.file.rows[key]._replace(data={"nonsense": 1})

    again = Starts(here.file)
    again.now_s = here.now_s
    await again.restore()
    await again.start(seed=9)

    assert again.part.choose_baseline(ids[2], client="alice").id == ids[2]
    assert len(again.sink.of(StartRecord)) == 1


@virtually
async def test_a_bug_in_one_part_costs_neither_the_others_nor_the_line(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Broken:
        kinds = ()

        def __getattr__(self, name: str) -> Any:
            raise ZeroDivisionError(name)

    here = Starts()
    here.history = StarterHistory("pump", [Broken(), here.part])  # type: ignore[list-item]
    await here.restore()
    for number in range(3):
        await here.start(seed=number)

    assert len(here.sink.of(StartRecord)) == 3
    assert 1 <= len(caplog.records) <= 3, "the same bug is logged once"


@virtually
async def test_without_the_file_starts_are_recorded_all_the_same() -> None:
    here = Starts()
    here.file.is_away = True
    here.part.restore(())
    for number in range(8):
        await here.start(seed=number)

    assert len(here.sink.of(StartRecord)) == 8
    assert here.part.choose_baseline(None, client="alice").is_baseline


def test_the_points_of_a_start_are_those_that_the_family_has() -> None:
    points = {setup.profile.family: StartPoints.of(setup.profile) for setup in setups(site())}

    assert points["ssw07"].columns[-1] == "p050"
    assert "accelerating" in points["sst"].motion
    assert {"s5_1_1_3", "s5_1_1_12"} <= points["ssw900"].motion
    assert all(each.has_acceleration for each in points.values())


async def test_a_disk_that_cannot_be_written_is_an_event_and_starts_are_stored_once_it_can(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "state"
    folder.write_text("no folder")
    events: asyncio.Queue[tuple[str, Severity]] = asyncio.Queue()
    sink = RecordingSink()

    def report(code: str, severity: Severity, _text: str) -> None:
        events.put_nowait((code, severity))

    service = HistoryService(
        folder,
        setups(site()),
        boot="boot",
        records=RecordWriter(sink, SystemClock()),
        publish_event=report,
        make_file=lambda path, on_news: HistoryStore(path, on_news=on_news, retry_s=0.02),
    )
    service.start()
    async with asyncio.timeout(10.0):
        assert await events.get() == ("history_unavailable", Severity.WARNING)
        await service.loaded()
        for readings in ReadMotor(AnalyticStart(20.0), is_ours=True).replies(0.0, 40.0):
            service.take_readings("pump", readings)
        await service.flushed()
        await asyncio.sleep(0)
        assert len(sink.of(StartRecord)) == 1
        folder.unlink()
        assert await events.get() == ("history_available", Severity.INFO)
    await service.loaded()  # earlier months are read now, and this one goes on from them
    await service.close()

    kinds = {row.kind for row in read_history(folder, "pump")}
    assert kinds == {"month", "curve", "start", "counters", "undelivered"}


async def test_a_disk_that_cannot_be_read_at_first_loses_neither_baseline_nor_month(tmp_path: Path) -> None:
    folder, away = tmp_path / "state", tmp_path / "away"
    events: asyncio.Queue[str] = asyncio.Queue()

    def service(boot: str) -> HistoryService:
        return HistoryService(
            folder,
            setups(site()),
            boot=boot,
            records=RecordWriter(RecordingSink(), SystemClock()),
            publish_event=lambda code, *_: events.put_nowait(code),
            make_file=lambda path, on_news: HistoryStore(path, on_news=on_news, retry_s=0.02),
        )

    async def start_six_times(one: HistoryService, ramp_s: float) -> None:
        for number in range(6):
            motor = ReadMotor(AnalyticStart(20.0, ramp_s), is_ours=True, seed=number)
            for readings in motor.replies(0.0, 20.0 + ramp_s + 8.0):
                late_s = 100.0 * number
                moved = readings._replace(at_s=readings.at_s + late_s, time_s=readings.time_s + late_s)
                one.take_readings("pump", moved)
            await asyncio.sleep(0)

    def stored(kind: str) -> list[Mapping[str, Any]]:
        return [row.data for row in read_history(folder, "pump") if row.kind == kind]

    async with asyncio.timeout(20.0):
        first = service("boot-1")
        first.start()
        await first.loaded()
        await start_six_times(first, 8.0)
        await first.close()
        baseline = stored("baseline")
        folder.rename(away)
        folder.write_text("no folder")
        second = service("boot-2")
        second.start()
        assert await events.get() == "history_unavailable"
        await second.loaded()
        await start_six_times(second, 12.0)
        folder.unlink()
        away.rename(folder)
        assert await events.get() == "history_available"
        await second.loaded()
        await second.close()

    assert stored("baseline")[0]["starts"] == baseline[0]["starts"]
    assert [month["outcomes"] for month in stored("month")] == [{"full_voltage": 12}]
    assert len(stored("start")) == 12
