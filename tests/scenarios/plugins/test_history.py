"""Records of starts and trips, the motors' counters, baseline and drift: what docs/history.md promises."""

from __future__ import annotations

import asyncio
import json
import random
import re
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import comtrade
import pytest

from gateway.plugins.history.starts import CURVES
from gateway.sim.core.power import MotorData
from gateway.store import read_history
from gateway.store.database import Database
from tests.rig import (
    RigPlant,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    played,
    reload,
    result,
    results,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.rows import act
from tests.rig.sites import ALICE, FOUR, QUICK, SSW06, SSW07, SSW900, operator, table
from tests.scenarios.plugins.doors import BRISK, SLOW

LIMITED = SSW07 + table("line.starter.rules", starts_per_hour=2, minimum_pause_s=10) + ALICE
ONE = "starter/pump/start"
VALUE = "starter/pump/value/"
KILLS = 8


def cycles(count: int, *, first_s: float = 3.0, every_s: float = 14.0, starter: str = "mill") -> dict:  # type: ignore[type-arg]
    """Start and stop a motor so often."""
    at: dict[float, object] = {}
    for number in range(count):
        at[first_s + number * every_s] = command(f"{starter}/alice/start")
        at[first_s + number * every_s + every_s - 3.0] = command(f"{starter}/alice/stop")
    return at


def samples(plant: RigPlant) -> str:
    """A record's samples are from one second before to five after full voltage, none of them invented."""
    record = plant.last("starter/mill/start")
    t_s, current = record["samples"]["t_s"], record["samples"]["current"]
    known = [amperes for amperes in current if amperes is not None]
    is_right = -1.1 <= t_s[0] < 0 and t_s[-1] == pytest.approx(10, abs=1.2) and max(known) == record["peak_a"]
    return "" if is_right and len(t_s) == len(current) else str(record)


def before_the_trip(plant: RigPlant) -> str:
    """A trip's record has the current before and after it, at ascending times."""
    readings = plant.last("starter/pump/trip")["readings"]
    t_s, current = readings["t_s"], readings["points"]["current"]
    before = [amperes for at_s, amperes in zip(t_s, current, strict=True) if at_s < 0 and amperes]
    after = [amperes for at_s, amperes in zip(t_s, current, strict=True) if at_s > 1 and amperes is not None]
    is_right = t_s == sorted(t_s) and t_s[0] < -8 and before and before[-1] > 50 and set(after) == {0.0}
    return "" if is_right else str(readings)


def once(topic: str):  # type: ignore[no-untyped-def]
    """Each record of the topic has come once."""

    def check(plant: RigPlant) -> str:
        ids = [each.json["id"] for each in plant.messages(topic)]
        return "" if ids and len(ids) == len(set(ids)) else f"{topic}: {ids}"

    return check


STARTS = [
    *(
        scene(
            f"a start of {name} by a command is recorded with its cause, times and curve",
            FOUR + ALICE,
            {3.0: command(f"{name}/alice/start", id="c1")},
            19.0,
            msg(
                f"starter/{name}/start",
                cause={"source": "command", "client": "alice", "command_id": "c1"},
                outcome="full_voltage",
                time=re.compile("2026-11-21T00:00:03"),
                acceleration_s=pytest.approx(4.0 if name == "belt" else 5.0, abs=0.3),
                resolution_s=pytest.approx(0.2, abs=0.15),
                peak_a=pytest.approx(255.0 if name == "belt" else 298.0, rel=0.03),
                i2t_a2s=pytest.approx(229_000.0 if name == "belt" else 380_000.0, rel=0.03),
                samples={"t_s": ..., "current": ...},
                qos=1,
                retain=False,
            ),
            sim={name: SLOW},
        )
        for name in ("pump", "fan", "mill", "belt")
    ),
    scene(
        "an SSW900's own maximum, mean and time of the start stand beside ours, and the start's samples",
        SSW900 + ALICE,
        {3.0: command("mill/alice/start")},
        18.0,
        samples,
        msg(
            "starter/mill/start",
            standstill_s=pytest.approx(3, abs=1),
            rate_hz=pytest.approx(4, abs=1.2),
            own={
                "D4.1.1": {"value": pytest.approx(298.0, rel=0.03), "unit": "A", "name": ...},
                "D4.1.2": {"value": pytest.approx(275.0, rel=0.1), "unit": "A", "name": ...},
                "D4.2.2": {"value": pytest.approx(5.0, abs=1.0), "unit": "s", "name": ...},
            },
        ),
        sim={"mill": SLOW},
    ),
    row(
        "an end of the gateway gives up the start under way",
        given=SSW07 + ALICE,
        sim={"pump": SLOW},
        at={3.0: command("pump/alice/start"), 6.0: "restart"},
        then={10.0: [seen(ONE, times=1, outcome="given_up"), once(ONE)]},
    ),
    row(
        "a start that goes on after a kill is recorded by the next run",
        given=SSW07 + ALICE,
        sim={"pump": SLOW},
        at={3.0: command("pump/alice/start"), 5.0: "kill", 5.5: "start"},
        then={20.0: [seen(ONE, times=1, outcome="full_voltage"), msg(VALUE + "starts_total", value=1)]},
    ),
    scene(
        "a starter that was silent during its start at the keypad has a record of it, as local",
        SSW07 + ALICE,
        {
            3.0: [fault("silent", "pump"), "pump control local"],
            4.0: "pump keypad start",
            30.0: fault("heal", "pump"),
        },
        60.0,
        seen(ONE, times=1, cause={"source": "local"}),
        msg(VALUE + "starts_total", value=1, quality="good"),
        sim={"pump": SLOW},
    ),
]

DELIVERY = [
    scene(
        "what was not acknowledged before a kill the next run publishes word for word",
        SSW07 + ALICE,
        {
            3.0: command("pump/alice/start"),
            5.0: "broker down",
            14.0: "pump trip E05",
            34.0: ["kill", "broker up", "start"],
        },
        50.0,
        once(ONE),
        msg(ONE, outcome="full_voltage", time=re.compile("T00:00:03")),
        once("starter/pump/trip"),
        msg("starter/pump/trip", code="e05", state_before="running", time=re.compile("T00:00:1[456]")),
        sim={"pump": QUICK},
    ),
    scene(
        "a damaged file is set aside, said, and a new one counts from 0",
        SSW07 + ALICE,
        {
            3.0: command("pump/alice/start"),
            14.0: ["kill", lambda plant: damage(plant), "start"],
        },
        20.0,
        event("history_lost"),
        msg(VALUE + "starts_total", value=0),
        msg("gateway/status", state="online"),
        sim={"pump": QUICK},
    ),
    row(
        "a kill takes at most ten minutes of hours, an orderly end none",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start"), 650.0: "kill", 651.0: "start", 700.0: "restart"},
        then={
            660.0: msg(VALUE + "hours_total", value=pytest.approx(605 / 3600, abs=0.005)),
            710.0: msg(VALUE + "hours_total", value=pytest.approx(655 / 3600, abs=0.005)),
        },
    ),
]


def damage(plant: RigPlant) -> None:
    for path in (plant.folder / "state").glob("history.sqlite*"):
        path.write_bytes(b"no database" * 1000)


BASELINE = [
    row(
        "five good starts make the baseline, ten more that are otherwise a drift, until a new baseline",
        given=SSW900 + operator("alice", ("start", "stop", "baseline")),
        sim={"mill": BRISK},
        at={
            **cycles(15),
            71.0: "mill friction 60",
            217.0: "restart",
            221.0: command("mill/alice/baseline"),
        },
        then={
            69.0: seen("starter/mill/start", times=5, is_baseline=True),
            188.0: never("starter/mill/event", code="start_drift"),
            216.0: [
                event(
                    "start_drift",
                    "starter/mill/event",
                    severity="warning",
                    text=re.compile("acceleration time grew"),
                ),
                seen(
                    "starter/mill/start", drift={"acceleration_s": {"change_pct": pytest.approx(58, abs=9)}}
                ),
                retained("starter/mill/alarm/start_drift", active=True, severity="alarm"),
            ],
            220.0: [
                seen("starter/mill/event", times=1, code="start_drift"),
                retained("starter/mill/alarm/start_drift", active=True),
            ],
            223.0: [
                result("baseline confirmed ok"),
                retained("starter/mill/alarm/start_drift", active=False),
            ],
        },
    ),
    scene(
        "without a good start there is no baseline to choose, nor without the right",
        SSW07 + ALICE + operator("bob", may=("start",)),
        {3.0: command("pump/alice/baseline"), 4.0: command("pump/bob/baseline")},
        5.0,
        results("baseline accepted ok", "baseline rejected no_start", client="alice"),
        results("baseline rejected not_allowed", client="bob"),
        frames("pump"),
    ),
    row(
        "a start that is not among the last twenty is no baseline",
        given=SSW07 + ALICE,
        sim={"pump": SLOW},
        at={
            3.0: command("pump/alice/start"),
            20.0: command("pump/alice/baseline", args={"start": "0f3c-4711"}),
        },
        then={21.0: result("baseline rejected no_start")},
    ),
]

TRIPS = [
    row(
        "a trip is recorded with its code and the values before it",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start"), 15.0: "pump trip E05"},
        then={
            16.0: never("starter/pump/trip"),
            32.0: [
                seen(
                    "starter/pump/trip",
                    times=1,
                    code="e05",
                    text=re.compile("overload"),
                    state_before="running",
                    time=re.compile("T00:00:1[567]"),
                    retain=False,
                    qos=1,
                    readings={"constant": {"power_present": True}},
                ),
                before_the_trip,
            ],
        },
    ),
    row(
        "what the starter refuses to say of its fault is left out",
        given=SSW900 + ALICE,
        sim={"mill": QUICK},
        at={5.0: "mill trip F005", 5.2: fault("refuse", "mill", 2, (4,))},
        then={40.0: msg("starter/mill/trip", state_before=...)},
    ),
    row(
        "of a fault that was there at first it is not known what came before",
        given=SSW07,
        sim={"pump": QUICK},
        at={2.0: "end", 3.0: "pump trip E05", 4.0: "start"},
        then={24.0: msg("starter/pump/trip", code="e05", state_before=None)},
    ),
    row(
        "a starter that falls silent with its trip has a record all the same",
        given=SSW07,
        at={15.0: "pump trip E05", 16.0: "pump power off"},
        then={40.0: msg("starter/pump/trip", code="e05", state_before="ready")},
    ),
    scene(
        "a step of the wall clock moves nothing within a record",
        SSW07,
        {10.0: lambda plant: setattr(plant.world, "stepped_s", -7200.0), 15.0: "pump trip E05"},
        35.0,
        that(lambda plant: -16 < plant.last("starter/pump/trip")["readings"]["t_s"][0] < -13),
    ),
    row(
        "a trip that was published was counted, whatever is killed then",
        given=SSW07,
        at={5.0: "pump trip E05", 22.0: "kill", 23.0: "start"},
        then={21.9: seen("starter/pump/trip", times=1), 28.0: msg(VALUE + "trips_by_code", value="e05:1")},
    ),
    row(
        "a number that is read some time after its fault is the record's",
        given=SSW07,
        at={5.0: ["pump P014 = 0", "pump trip E05"], 9.0: "pump P014 = -"},
        then={24.0: msg("starter/pump/trip", code="e05", text=re.compile("overload"))},
    ),
    row(
        "an alarm is no trip",
        given=SSW900,
        at={5.0: "mill alarm A005"},
        then={24.0: [retained("starter/mill/alarm/a005", active=True), never("starter/mill/trip")]},
    ),
]

COUNTERS = [
    row(
        "starts and trips are counted by their codes, as points of info; without a rule no starts are left",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/start"),
            15.0: "pump trip E05",
            26.0: "pump clear",
            28.0: "pump trip E24",
        },
        then={
            2.5: [msg(VALUE + "starts_total", value=0, unit=""), msg(VALUE + "trips_by_code", value="")],
            3.0: [
                msg(
                    "starter/pump/info",
                    points={"hours_total": {"unit": "h"}, "trips_by_code": {"type": "string"}},
                ),
                msg(VALUE + "starts_left", quality="bad", value=None),
                msg(VALUE + "pause_left_s", value=0.0),
            ],
            50.0: [
                msg(VALUE + "starts_total", value=1),
                msg(VALUE + "trips_total", value=2),
                msg(VALUE + "trips_by_code", value="e05:1 e24:1"),
                seen("starter/pump/trip", times=2),
                once("starter/pump/trip"),
            ],
        },
    ),
    row(
        "standstill is counted until the motor turns, and then its hours by the load",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={70.0: command("pump/alice/start")},
        then={
            69.0: msg(VALUE + "standstill_s", value=pytest.approx(60, abs=12)),
            80.0: msg(VALUE + "standstill_s", value=0.0),
            197.0: [
                msg(VALUE + "hours_total", value=pytest.approx(120 / 3600, abs=0.02), unit="h", retain=True),
                msg(VALUE + "hours_normal", value=pytest.approx(120 / 3600, abs=0.02)),
                msg(VALUE + "hours_over", value=0.0),
            ],
        },
    ),
    scene(
        "counters of a silent starter are stale and stand still, and a step of the wall clock adds no hours",
        SSW07 + ALICE,
        {
            3.0: command("pump/alice/start"),
            10.0: lambda plant: setattr(plant.world, "stepped_s", 86400.0),
            90.0: fault("silent", "pump"),
        },
        150.0,
        msg(VALUE + "hours_total", quality="stale", value=pytest.approx(85 / 3600, abs=0.003)),
        msg(VALUE + "starts_total", quality="stale", value=1),
        sim={"pump": QUICK},
    ),
    row(
        "the starts that are left count down, and the last but one is an event",
        given=LIMITED,
        sim={"pump": QUICK},
        at={
            13.0: command("pump/alice/start"),
            24.0: command("pump/alice/stop"),
            40.0: command("pump/alice/start"),
        },
        then={
            2.9: msg(VALUE + "starts_left", value=2, quality="good"),
            22.0: [msg(VALUE + "starts_left", value=1), event("one_start_left", "starter/pump/event")],
            27.0: [msg(VALUE + "pause_left_s", value=pytest.approx(8, abs=3), unit="s")],
            60.0: [
                msg(VALUE + "starts_left", value=0),
                msg(VALUE + "pause_left_s", value=pytest.approx(3550, abs=30)),
                seen("starter/pump/event", times=1, code="one_start_left"),
            ],
        },
    ),
    scene(
        "energy is the motor's where the starter gives its power, and is published once a minute",
        SSW06 + ALICE,
        {10.0: command("fan/alice/start")},
        200.0,
        msg(
            "starter/fan/value/energy_kwh",
            value=pytest.approx(33.5 * 180 / 3600, rel=0.1),
            unit="kWh",
        ),
        that(lambda plant: len(plant.messages("starter/fan/value/energy_kwh", since=12.0)) <= 4),
        sim={"fan": QUICK},
    ),
    row(
        "an SSW900's own counter of starts wins, and the pause that it demands counts",
        given=SSW900 + ALICE,
        sim={"mill": {**QUICK, "settings": {932: 900}}},  # C5.7.2: 90.0 s after a stop
        at={100.0: command("mill/alice/start")},
        then={
            180.0: [
                msg("starter/mill/value/pause_left_s", value=90.0),
                msg("starter/mill/value/starts_total", value=1),
                msg("starter/mill/info", points={"starts_total": {"code": "D4.7.1"}}),
            ]
        },
    ),
    row(
        "a starter that returns under its name goes on with its counts",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/start"),
            15.0: reload(SSW06 + ALICE),
            20.0: reload(SSW07 + ALICE),
        },
        then={
            19.0: [msg("starter/fan/value/starts_total", value=0), retained(VALUE + "starts_total")],
            26.0: msg(VALUE + "starts_total", value=1, quality="good"),
        },
    ),
]


test_history = played(STARTS + DELIVERY + TRIPS + COUNTERS)
test_baseline_and_drift = played(BASELINE)


@pytest.fixture
def away() -> Iterator[pytest.MonkeyPatch]:
    """Let the history's file be one that cannot be opened, until this is undone."""
    connect = sqlite3.connect

    def connect_unless_away(path: Path, **options: Any) -> Any:
        if Path(path).name == "history.sqlite":
            raise OSError("the disk is away")
        return connect(path, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", connect_unless_away)
        yield patch


@pytest.mark.usefixtures("away")
def test_a_history_that_is_away_for_too_long_is_said_to_lack_the_oldest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gateway.mqtt.outbox.backlog.MOST_NEEDED", 1)
    with RigPlant(SSW07) as plant:
        for at_s in (4.0, 8.0):
            plant.run(until=at_s)
            act(plant, "pump trip E05")
            plant.run(until=at_s + 2.0)
            act(plant, "pump clear")
        plant.run(until=12.0)

        lost = [each.json for each in plant.messages("gateway/event") if each.json["code"] == "history_lost"]
        assert ["1 more of the oldest starts and trips are missing" in each["text"] for each in lost] == [
            True
        ]


def test_while_the_file_cannot_be_opened_starts_are_recorded_and_stored_once_it_can(
    away: pytest.MonkeyPatch,
) -> None:
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}) as plant:
        plant.run(until=3.0)
        plant.command("pump/alice/start")
        plant.run(until=15.0)
        assert "history_unavailable" in plant.events()
        assert len(plant.messages(ONE)) == 1

        away.undo()
        plant.run(until=100.0)
        assert "history_available" in plant.events()
        plant.restart()
        plant.run(until=105.0)

        assert plant.last(VALUE + "starts_total")["value"] == 1
        assert len(plant.messages(ONE)) == 1


FAULT_LISTS = {  # of the table in docs/history.md
    "pump": ["P014", "P015", "P016", "P017"],
    "fan": ["P060", "P063", "P066", "P069", "P072", "P075"],
    "mill": [],
    "belt": [],
}
AT_FAULT = {"pump": {"P050", "P081"}, "fan": {"P047"}, "mill": {"D4.1.1", "D2.1.1"}, "belt": {"R12", "R20"}}


def test_a_trip_of_each_family_has_what_its_manual_shows_and_another_reader_reads_its_comtrade() -> None:
    with RigPlant(FOUR + ALICE, sim=dict.fromkeys(FAULT_LISTS, QUICK)) as plant:
        plant.run(until=3.0)
        for name in FAULT_LISTS:
            plant.command(f"{name}/alice/start")
        plant.run(until=20.0)
        for name, fault_code in zip(FAULT_LISTS, ("E05", "E05", "F005", "COIL12"), strict=True):
            plant.do(lambda name=name, code=fault_code: plant.lines["pumps"].set_knob(name, "trip", code))
        plant.run(until=50.0)

        for name, codes in FAULT_LISTS.items():
            trip = plant.last(f"starter/{name}/trip")
            assert trip["state_before"] == "running"
            assert [each["code"] for each in trip["fault_history"]] == codes
            assert trip["at_fault"].keys() >= AT_FAULT[name]
            assert all(
                each["name"] and {"unit", "value"} <= each.keys() for each in trip["at_fault"].values()
            )
            assert len(plant.messages(f"starter/{name}/trip")[0].payload) <= 16 * 1024
            ran = plant.cli("history", "CONFIG", name, "--comtrade", str(plant.folder / name))
            reader = comtrade.Comtrade(use_double_precision=True)
            reader.load(str(plant.folder / f"{name}.cfg"), str(plant.folder / f"{name}.dat"))
            at_trip = list(reader.time).index(pytest.approx(reader.trigger_time, abs=1e-3))
            flag = list(reader.status[reader.status_channel_ids.index("fault")])
            assert (ran.code, flag[:at_trip], flag[at_trip]) == (0, [0] * at_trip, 1)
            assert max(reader.analog[reader.analog_channel_ids.index("current")][:at_trip]) > 50
        assert plant.last("starter/pump/trip")["fault_history"][0]["value"] == 5  # the newest first


def test_a_motor_that_tripped_by_heat_starts_when_the_estimated_time_is_over() -> None:
    motor = MotorData(ramp_up_s=1.0, full_voltage_s=0.2, coast_s=0.5, heating_s=60.0, cooling_s=300.0)
    with RigPlant(SSW07 + ALICE, sim={"pump": {"motor": motor}}) as plant:
        plant.run(until=3.0)
        plant.command("pump/alice/start")
        plant.run(until=20.0)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "load", "200"))
        while not plant.messages("starter/pump/trip"):
            plant.run(until=plant.world.now_s() + 5.0)
        tripped_s = plant.world.now_s()
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "load", "70"))
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "clear", ""))
        while not plant.last("starter/pump/value/restart_in_s")["value"]:
            plant.run(until=plant.world.now_s() + 5.0)
        estimate_s = plant.last("starter/pump/value/restart_in_s")["value"]
        learnt_s = plant.world.now_s()
        while plant.last("starter/pump/value/restart_in_s")["value"]:
            plant.run(until=plant.world.now_s() + 5.0)
        took_s = plant.world.now_s() - learnt_s
        plant.command("pump/alice/start")
        plant.run(until=plant.world.now_s() + 12.0)

        assert learnt_s - tripped_s >= 50.0, "learnt from a fall of a minute"
        assert took_s == pytest.approx(estimate_s, rel=0.3, abs=70.0)
        assert plant.last("starter/pump/start")["outcome"] == "full_voltage"


def kill_at_once(plant: RigPlant) -> None:
    """Kill the gateway, and begin with the files as they were then: no thread has written anything more."""
    state = plant.folder / "state"
    files = {path: path.read_bytes() for path in state.iterdir() if path.is_file()}
    plant.kill()
    for path in filter(Path.is_file, state.iterdir()):
        path.unlink()
    for path, content in files.items():
        if not path.name.endswith("-shm"):
            path.write_bytes(content)
    plant.start()


@pytest.mark.parametrize("seed", range(3))
def test_after_kills_at_any_transaction_each_start_was_published_and_is_stored_once(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    dice, transact = random.Random(seed), Database.transact
    followers: list[Callable[[], object]] = []

    def transacted(database: Database, *works: Any, **how: Any) -> list[Any]:
        answers = transact(database, *works, **how)
        for each in followers:
            each()
        return answers

    monkeypatch.setattr(Database, "transact", transacted)
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}, seed=seed) as plant:
        plant.run(until=4.0)
        for _ in range(KILLS):
            plant.command("pump/alice/start")
            plant.run(until=plant.world.now_s() + 3.0)  # its record is made 3 s later
            act(plant, dice.choice(("broker up", "broker up", "broker down")))
            counted = asyncio.Semaphore(0)
            followers[:] = [lambda counted=counted: plant.loop.call_soon(counted.release)]
            for _ in range(dice.randint(1, 4)):  # to the outbox, to the history, to the counters
                plant.await_(asyncio.wait([plant.loop.create_task(counted.acquire())], timeout=4.0))
            followers.clear()
            kill_at_once(plant)
            act(plant, "broker up")
            plant.run(until=plant.world.now_s() + 10.0)
            plant.command("pump/alice/stop")
            plant.run(until=plant.world.now_s() + 4.0)
        plant.end()

        payloads = {each.payload for each in plant.messages(ONE)}
        ids = [json.loads(each)["id"] for each in sorted(payloads, key=lambda each: json.loads(each)["time"])]
        rows = read_history(plant.folder / "state", "pump")
        of = {
            kind: [row for row in rows if row.kind == kind]
            for kind in ("start", "curve", "month", "counters")
        }
        assert [row.id for row in of["start"]] == ids
        assert {row.id for row in of["curve"]} == set(ids[-CURVES:])
        assert sum(row.data["outcomes"]["full_voltage"] for row in of["month"]) == len(ids) > KILLS / 2
        assert sum(row.data["totals"]["starts"] for row in of["counters"]) == len(ids)
