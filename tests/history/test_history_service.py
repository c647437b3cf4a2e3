"""The history of a plant's starters, from the wire to the records; in virtual time, on simulated lines."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from gateway.app.history import HistoryService
from gateway.app.history.part import Surroundings
from gateway.app.history.service import StarterHistory
from gateway.app.history.starts import CURVES, DRIFT, SUMMARIES, StartHistory
from gateway.history.readings import Readings
from gateway.history.start_recorder import StartPoints
from gateway.records import (
    AlarmRecord,
    AvailabilityRecord,
    EventRecord,
    Phase,
    RecordWriter,
    ResultRecord,
    Severity,
    StartRecord,
)
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.storage.history import FILE, HistoryStore, read_history
from gateway.system.clock import SystemClock
from tests.history.memory_file import MemoryFile
from tests.history.support import AnalyticStart, ReadMotor
from tests.plant_rig import RunningPlant, running, setups, site, starter
from tests.starters.fakes import RecordingSink
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock

OVER_S = 30.0  # a start with the time after it
FAMILIES = {"pump": ("hall", 1), "fan": ("hall", 2), "mill": ("yard", 1), "belt": ("yard", 2)}
WITHIN = 0.03


def desk(here: RunningPlant) -> Callable[..., Awaitable[ResultRecord]]:
    """Return what gives a command and awaits its final result."""
    rights = Rights([Operator("alice", ("*",), ("*",)), Operator("carol", ("start", "stop"), ("*",))])
    commander = Dispatcher(
        here.plant.starters, rights=rights, set_baseline=here.history.set_baseline, records=here.records
    )
    count = 0

    async def give(
        name: str, verb: str, *, client: str = "alice", within_s: float = 20.0, **args: Any
    ) -> ResultRecord:
        nonlocal count
        count += 1
        now_s = here.records.clock.now_s()
        request = CommandRequest(name, client, verb, f"c{count}", args, received_s=now_s, expires_s=now_s + 5)
        commander.submit(request)
        for _ in range(int(within_s / 0.1)):
            if (found := _final(here, f"c{count}")) is not None:
                return found
            await asyncio.sleep(0.1)
        raise AssertionError(f"{verb} of {name} has no final result")

    return give


def _final(here: RunningPlant, id_: str) -> ResultRecord | None:
    return next((r for r in here.sink.of(ResultRecord) if r.id == id_ and r.phase.is_final), None)


def starts(here: RunningPlant, name: str) -> list[Mapping[str, Any]]:
    return [record.data for record in here.sink.of(StartRecord) if record.starter == name]


@virtually
@pytest.mark.parametrize("name", FAMILIES)
async def test_a_commanded_start_of_each_family_agrees_with_its_motor_within_three_percent(name: str) -> None:
    async with running() as here:
        give = desk(here)
        motor = here.unit(*FAMILIES[name]).motor
        await asyncio.sleep(0.1)  # which poll is the last of the record depends on when the start comes
        assert (await give(name, "start")).phase is Phase.CONFIRMED
        await asyncio.sleep(OVER_S)

        (record,) = starts(here, name)

        true = motor.data
        curve = AnalyticStart(
            0.0,
            true.ramp_up_s,
            first_a=1.5 * true.rated_current_a,
            peak_a=true.start_current_pct / 100 * true.rated_current_a,
            load_a=motor.current_a,
        )
        assert motor.start_s == pytest.approx(true.ramp_up_s)
        assert record["outcome"] == "full_voltage"
        assert record["cause"] == {"source": "command", "client": "alice", "command_id": "c1"}
        assert record["acceleration_s"] == pytest.approx(motor.start_s, rel=WITHIN)
        assert record["peak_a"] == pytest.approx(motor.start_max_a, rel=WITHIN)
        assert record["i2t_a2s"] == pytest.approx(curve.i2t_a2s(), rel=WITHIN)
        assert record["mean_a"] == pytest.approx(curve.mean_a(), rel=WITHIN)
        assert record["rate_hz"] >= 3.0
        assert record["samples"]["t_s"][0] >= -1.0
        assert record["samples"]["t_s"][-1] == pytest.approx(motor.start_s + 5.0, abs=0.8)
        assert [row["id"] for row in here.file.of(name, "start")] == [record["id"]]


@virtually
async def test_what_the_family_has_is_sampled_too() -> None:
    async with running() as here:
        give = desk(here)
        await give("mill", "start")
        await give("pump", "start")
        await asyncio.sleep(OVER_S)

        (mill,), (pump,) = starts(here, "mill"), starts(here, "pump")

        for name in ("current", "line_voltage", "output_voltage", "torque_pct", "power_factor"):
            assert any(value is not None for value in mill["samples"][name]), name
        assert 300 < mill["lowest_v"] < 400
        assert pump["heating_pct"] > 0
        assert mill["heating_pct"] > 0
        motor = here.unit("hall", 1).motor
        assert pump["heating_pct"] == pytest.approx(motor.thermal_pct * 2.5, abs=10.0)  # of 250 %


@virtually
async def test_a_start_at_the_keypad_is_local_and_standstill_is_known() -> None:
    async with running() as here:
        give = desk(here)
        await give("pump", "start")
        await asyncio.sleep(OVER_S)
        await give("pump", "stop")
        await asyncio.sleep(60.0)
        unit = here.unit("hall", 1)
        unit.set_remote(is_remote=False)  # type: ignore[attr-defined]
        await asyncio.sleep(3.0)

        unit.motor.start()
        await asyncio.sleep(OVER_S)

        ours, local = starts(here, "pump")
        assert ours["cause"]["source"] == "command"
        assert local["cause"] == {"source": "local"}
        assert local["standstill_s"] == pytest.approx(63.0 - 4.0 - 0.0, abs=2.5)
        assert local["acceleration_s"] == pytest.approx(8.0, abs=local["resolution_s"])


@virtually
async def test_a_trip_during_the_start_ends_the_record() -> None:
    async with running() as here:
        await desk(here)("pump", "start")
        await asyncio.sleep(3.0)
        here.unit("hall", 1).trip(5)
        await asyncio.sleep(OVER_S)

        (record,) = starts(here, "pump")
        assert record["outcome"] == "tripped"
        assert "acceleration_s" not in record


@virtually
async def test_a_starter_that_falls_silent_while_it_starts_leaves_what_is_known() -> None:
    async with running() as here:
        await desk(here)("pump", "start")
        await asyncio.sleep(3.0)
        here.unit("hall", 1).is_powered = False
        await asyncio.sleep(OVER_S)

        (record,) = starts(here, "pump")
        assert record["outcome"] == "given_up"
        assert record["peak_a"] > 100


@virtually
async def test_the_first_five_starts_make_the_baseline_and_an_operator_chooses_another() -> None:
    async with running() as here:
        give = desk(here)
        for _ in range(6):
            await give("belt", "start")
            await asyncio.sleep(OVER_S)
            await give("belt", "stop")
            await asyncio.sleep(OVER_S)
        records = starts(here, "belt")
        assert [record["is_baseline"] for record in records] == [True] * 5 + [False]
        (stored,) = here.file.of("belt", "baseline")
        assert stored["client"] is None
        assert stored["values"]["acceleration_s"] == pytest.approx(4.0, rel=WITHIN)
        (curve,) = here.file.of("belt", "baseline_curve")
        assert curve["t_s"]

        latest = await give("belt", "baseline")
        named = await give("belt", "baseline", start=records[1]["id"])

        assert (latest.phase, latest.values["start"]) == (Phase.CONFIRMED, records[5]["id"])
        assert (named.phase, named.values["start"]) == (Phase.CONFIRMED, records[1]["id"])
        (stored,) = here.file.of("belt", "baseline")
        assert (stored["client"], stored["starts"]) == ("alice", [records[1]["id"]])
        marked = [row["id"] for row in here.file.of("belt", "start") if row["is_baseline"]]
        assert marked == [records[1]["id"]]


@virtually
async def test_a_baseline_needs_a_good_start_and_the_right_to_choose() -> None:
    async with running() as here:
        give = desk(here)

        nothing = await give("pump", "baseline")
        unknown = await give("pump", "baseline", start="boot-77")
        bad = await give("pump", "baseline", start=7)
        strange = await give("pump", "baseline", when="now")
        forbidden = await give("pump", "baseline", client="carol")

        assert [(r.phase, r.code) for r in (nothing, unknown)] == [(Phase.REJECTED, "no_start")] * 2
        assert [(r.phase, r.code) for r in (bad, strange)] == [(Phase.REJECTED, "bad_arguments")] * 2
        assert (forbidden.phase, forbidden.code) == (Phase.REJECTED, "not_allowed")
        assert here.writes() == 0


@virtually
async def test_a_reload_ends_the_record_under_way_and_the_history_goes_on_under_the_same_name() -> None:
    fan = starter("fan", 2, "ssw06")
    async with running() as here:
        give = desk(here)
        await give("fan", "start")
        await asyncio.sleep(3.0)

        await here.reload((fan, fan.replace("address = 2", "address = 7")))
        here.connect("hall", 7, "ssw06")
        await asyncio.sleep(20.0)
        await desk(here)("fan", "start", within_s=60.0)
        await asyncio.sleep(OVER_S)

        assert [record["outcome"] for record in starts(here, "fan")] == ["given_up", "full_voltage"]


@virtually
async def test_a_starter_that_goes_takes_its_recorder_along_and_one_that_comes_gets_one() -> None:
    fan = starter("fan", 2, "ssw06")
    async with running() as here:
        await here.reload((fan, ""))
        assert set(here.history.starters) == {"pump", "mill", "belt"}

        await here.reload()
        await asyncio.sleep(20.0)
        await desk(here)("fan", "start")
        await asyncio.sleep(OVER_S)

        assert [record["outcome"] for record in starts(here, "fan")] == ["full_voltage"]


@virtually
async def test_the_end_of_the_gateway_ends_the_record_under_way() -> None:
    async with running() as here:
        await desk(here)("pump", "start")
        await asyncio.sleep(3.0)
        here.plant.end("the gateway ended")
        await here.history.close()

        assert [row["outcome"] for row in here.file.of("pump", "start")] == ["given_up"]


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
async def test_a_start_that_goes_on_while_the_gateway_restarts_is_recorded_once() -> None:
    motor = ReadMotor(AnalyticStart(20.0, 30.0))
    replies = list(motor.replies(0.0, 70.0))
    file, found = MemoryFile(), []
    for since_s, until_s in ((0.0, 30.0), (36.0, 70.0)):
        here = Starts(file)
        await here.restore()
        for readings in replies:
            if since_s <= readings.at_s < until_s:
                here.history.each(lambda part, readings=readings: part.take_readings(readings))  # type: ignore[misc]
        here.history.each(lambda part: part.close())
        found += [record.data["outcome"] for record in here.sink.of(StartRecord)]

    assert found == ["given_up"]
    assert [row["outcome"] for row in file.of("pump", "start")] == ["given_up"]


@virtually
async def test_a_start_that_goes_on_after_a_kill_is_recorded_by_the_next_run() -> None:
    here = Starts()
    await here.restore()
    for readings in ReadMotor(AnalyticStart(-10.0, 30.0)).replies(0.0, 40.0):
        here.history.each(lambda part, readings=readings: part.take_readings(readings))  # type: ignore[misc]

    assert [record.data["outcome"] for record in here.sink.of(StartRecord)] == ["full_voltage"]


@virtually
async def test_fifty_ever_slower_starts_raise_the_alarm_once_also_over_restarts() -> None:
    here = Starts()
    await here.restore()
    events, alarms = [], []
    for number in range(55):
        await here.start(8.0 * (1 + 0.01 * max(0, number - 5)), seed=number)
        if number % 10 == 9:
            events, alarms = events + here.events(), alarms + here.alarms()
            here.part.close()
            now_s, here = here.now_s, Starts(here.file)
            here.now_s = now_s
            await here.restore()

    events, alarms = events + here.events(), alarms + here.alarms()
    assert events == [DRIFT]
    assert alarms
    assert all(alarms), "active, and published again by each run"
    assert here.part.choose_baseline(None, client="alice").is_baseline
    assert here.alarms()[-1] is False


@virtually
async def test_five_hundred_equal_starts_raise_nothing_and_the_file_stays_bounded() -> None:
    here = Starts()
    await here.restore()
    for number in range(500):
        await here.start(8.0, seed=number)

    assert here.events() == []
    assert len(here.file.of("pump", "start")) == SUMMARIES
    assert len(here.file.of("pump", "curve")) == CURVES
    assert len(here.file.of("pump", "baseline")) == 1
    assert len(here.sink.of(StartRecord)) == 500


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


@virtually
async def test_a_starter_that_is_switched_off_in_the_configuration_is_no_start() -> None:
    here = Starts()
    await here.restore()
    here.history.each(lambda part: part.take_record(AvailabilityRecord("pump", "disabled", 0.0, None)))
    here.history.each(lambda part: part.take_readings(Readings(1.0, 1.0, "unknown", {})))

    assert here.sink.of(StartRecord) == []


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


async def test_a_history_that_was_damaged_is_an_event(tmp_path: Path) -> None:
    (tmp_path / FILE).write_bytes(b"no database at all" * 500)
    events: list[str] = []
    service = HistoryService(
        tmp_path,
        setups(site()),
        boot="boot",
        records=RecordWriter(RecordingSink(), SystemClock()),
        publish_event=lambda code, _severity, _text: events.append(code),
    )
    service.start()
    await service.loaded()
    await service.close()

    assert events == ["history_lost"]
