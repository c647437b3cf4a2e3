"""The gateway's own rules between a command and its first write: a slow disk, locks and changes meanwhile."""

from __future__ import annotations

import asyncio

import pytest

from gateway.errors import CommandError
from gateway.records import EventRecord, LockRecord, Phase
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.preconditions import Guard
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.policy.start_rules import PolicySettings, RuleSet
from tests.starters.fakes import AT_SPEED, VB01
from tests.starters.plant import FakeMemory, Plant
from tests.starters.rig import virtually


@virtually
async def test_a_start_that_cannot_be_counted_on_the_disk_is_refused_where_starts_are_counted() -> None:
    plant = await Plant({"pump-1": RuleSet(starts_per_hour=5)}).online()
    plant.memory.is_away = True

    assert await plant.do("start", "1") == "not_kept"
    assert await plant.do("start", "2", starter="pump-2") == "ok"

    assert plant.starts("pump-1") == 0
    assert [e.code for e in plant.sink.of(EventRecord) if not e.starter] == ["memory_away"]
    plant.memory.is_away = False
    await plant.wait(10.0)
    assert [e.code for e in plant.sink.of(EventRecord) if not e.starter] == ["memory_away", "memory_back"]
    assert await plant.do("start", "3") == "ok"


@virtually
async def test_a_slow_disk_has_the_status_read_again_before_the_start() -> None:
    plant = await Plant({"pump-1": RuleSet(starts_per_hour=5)}).online()
    plant.memory.save_s = 0.6
    plant.submit("start")
    await asyncio.sleep(0.3)
    plant.machines["pump-1"].unit.holding[VB01] = AT_SPEED  # someone starts it locally
    await plant.wait(3.0)

    assert plant.sink.final("1").code == "motor_running"
    assert plant.starts() == 0


@virtually
async def test_a_stop_while_the_start_is_being_counted_leaves_it_unwritten() -> None:
    plant = await Plant({"pump-1": RuleSet(starts_per_hour=5)}).online()
    plant.memory.save_s = 0.6
    plant.submit("start", "1")
    await asyncio.sleep(0.3)

    plant.submit("stop", "2")
    await plant.wait(3.0)

    assert plant.sink.final("1").code == "stopped_first"
    assert plant.sink.final("2").code == "ok"
    assert plant.starts() == 0


@virtually
async def test_a_lock_comes_before_a_start_that_is_not_yet_written() -> None:
    plant = await Plant().online()
    plant.submit("start", "1", client="bob")
    await asyncio.sleep(0.01)

    plant.submit("lock", "2", args={"reason": "belt is off"})
    await plant.wait(3.0)

    assert plant.sink.final("1").code == "locked"
    assert plant.sink.final("2").code == "ok"
    assert plant.starts() == 0


@virtually
async def test_a_lock_that_cannot_be_stored_holds_and_an_unlocking_that_cannot_be_stored_does_not() -> None:
    plant = await Plant().online()
    plant.memory.is_away = True

    assert await plant.do("lock", "1", args={"reason": "belt is off"}) == "not_kept"
    assert await plant.do("start", "2") == "locked"
    assert await plant.do("unlock", "3") == "not_kept"
    assert await plant.do("start", "4") == "locked"
    assert {plant.sink.final(id_).phase for id_ in "13"} == {Phase.FAILED}


def take_over(plant: Plant, policy: PolicySettings, *operators: Operator) -> None:
    rights = Rights(operators or (Operator("alice", ("*",), ("*",)),))
    for name in plant.policy.apply(policy, rights=rights):
        plant.machines[name].telemetry.republish_state()
    plant.dispatcher.apply_rights(rights)


@virtually
async def test_a_change_waits_for_the_command_and_lets_no_new_one_but_stop_begin() -> None:
    plant = await Plant().online()
    plant.submit("start", "1")

    settling = asyncio.create_task(plant.dispatcher.settle(["pump-1"], within_s=15.0))
    await asyncio.sleep(0)
    assert not settling.done()
    await plant.wait(3.0)

    assert settling.done()
    assert plant.sink.final("1").phase is Phase.CONFIRMED
    assert await plant.do("read", "2", args={"parameter": "P003"}) == "busy"
    assert await plant.do("read", "3", starter="pump-2", args={"parameter": "P003"}) == "ok"
    assert await plant.do("stop", "4") == "ok"
    take_over(plant, PolicySettings())
    assert await plant.do("read", "5", args={"parameter": "P003"}) == "ok"


@virtually
async def test_a_change_waits_for_a_stop_but_not_for_ever() -> None:
    plant = await Plant().online()
    machine = plant.machines["pump-1"]
    machine.set_motor(is_on=True)
    machine.unit.on_write = lambda _: None  # it does not obey
    plant.submit("stop", None)

    began_s = plant.clock.now_s()
    await plant.dispatcher.settle(["pump-1"], within_s=2.0)

    assert plant.clock.now_s() - began_s == 2.0


@virtually
async def test_what_may_have_been_locked_is_locked_once_somebody_could_unlock_it() -> None:
    memory = FakeMemory()
    memory.is_damaged = True
    plant = await Plant(memory=memory, operators=()).online()
    assert plant.policy.motor_history.lock_of("pump-1") is None

    take_over(plant, PolicySettings())
    assert await plant.do("start", "1") == "locked"
    assert await plant.do("unlock", "2") == "ok"
    take_over(plant, PolicySettings())

    assert await plant.do("start", "3") == "ok"
    assert plant.locks()[:1] == ["gateway"]
    assert plant.sink.of(EventRecord)[-1].code != "memory_damaged"


def test_a_page_that_a_starter_had_before_stays() -> None:
    motor_history = MotorHistory(["pump"])
    motor_history.note_start("pump", now_s=1.0)

    motor_history.add("pump")
    motor_history.add("fan")

    assert motor_history.starts_since("pump", 0.0) == [1.0]
    assert motor_history.lock_of("fan") is None


LOCK = LockRecord("alice", 0.0, "belt is off")


def guard(plant: Plant, verb: str, *, expires_s: float | None = None) -> Guard:
    return plant.policy.guard(
        CommandRequest("pump-1", "alice", verb, "1", received_s=0.0, expires_s=expires_s), ()
    )


@virtually
async def test_a_lock_set_or_a_time_run_out_while_the_start_is_being_counted_stops_it() -> None:
    for expires_s, code in ((None, "locked"), (0.2, "expired")):
        plant = Plant({"pump-1": RuleSet(starts_per_hour=5)})
        plant.memory.save_s = 0.5
        now_s = plant.clock.now_s()
        admission = asyncio.create_task(
            guard(plant, "start", expires_s=None if expires_s is None else now_s + expires_s).admit()
        )
        await asyncio.sleep(0.3)
        plant.policy.motor_history.set_lock("pump-1", LOCK if code == "locked" else None)

        with pytest.raises(CommandError) as caught:
            await admission

        assert caught.value.code == code


@virtually
async def test_a_start_does_not_stand_in_its_own_way() -> None:
    plant = Plant({"pump-1": RuleSet(starts_per_hour=1)})
    starting = guard(plant, "start")

    await starting.admit()
    starting.check({})

    with pytest.raises(CommandError):
        guard(plant, "start").check({})
