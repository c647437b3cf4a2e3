"""Other rights, rules and groups while commands are under way: new ones by the new, old ones to their end."""

from __future__ import annotations

import asyncio

from gateway.records import EventRecord, Phase, ResultRecord
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.rights import Operator, Rights
from gateway.starters.policy.start_rules import PolicySettings, RuleSet
from tests.starters.plant import FakeMemory, Plant
from tests.starters.rig import virtually

STRICT = PolicySettings(rules={"pump-1": RuleSet(minimum_pause_s=3600.0)})


def take_over(plant: Plant, policy: PolicySettings, *operators: Operator) -> None:
    rights = Rights(operators or (Operator("alice", ("*",), ("*",)),))
    for name in plant.policy.apply(policy, rights=rights):
        plant.machines[name].telemetry.republish_state()
    plant.dispatcher.apply_rights(rights)


@virtually
async def test_a_command_under_way_ends_by_the_rules_it_came_under() -> None:
    plant = await Plant().online()
    plant.submit("start", "old")

    take_over(plant, STRICT)
    await plant.wait(3.0)

    assert plant.sink.final("old").phase is Phase.CONFIRMED
    assert await plant.do("stop", "2") == "ok"
    assert await plant.do("start", "new") == "pause_too_short"


@virtually
async def test_rights_that_are_taken_away_end_with_the_next_command() -> None:
    plant = await Plant().online()
    plant.submit("start", "old")

    take_over(plant, PolicySettings(), Operator("bob", ("stop",), ("*",)))
    await plant.wait(3.0)

    assert plant.sink.final("old").phase is Phase.CONFIRMED
    assert await plant.do("read", "2", args={"parameter": "P003"}) == "not_allowed"
    assert await plant.do("stop", "3", client="bob") == "ok"


@virtually
async def test_groups_are_the_new_ones() -> None:
    plant = await Plant(policy=PolicySettings(groups={"old": ("pump-1",)})).online()

    take_over(plant, PolicySettings(groups={"new": ("pump-1", "pump-2")}))

    assert await plant.do("stop", "1", starter="old") == "unknown_starter"
    plant.submit("stop", "2", starter="new")
    await plant.wait(3.0)
    ends = {end.starter: end.phase for end in plant.sink.of(ResultRecord) if end.id == "2"}
    assert ends == dict.fromkeys(("new", "pump-1", "pump-2"), Phase.CONFIRMED)


@virtually
async def test_starts_and_locks_are_remembered_over_a_change_of_the_rules() -> None:
    plant = await Plant().online()
    await plant.do("start", "1")
    await plant.do("stop", "2")
    await plant.do("lock", "3", starter="pump-2", args={"reason": "belt"})

    take_over(plant, PolicySettings(rules={"pump-1": RuleSet(starts_per_hour=1)}))

    assert await plant.do("start", "4") == "too_many_starts"
    assert await plant.do("start", "5", starter="pump-2") == "locked"


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
async def test_nothing_is_waited_for_where_nothing_is_under_way() -> None:
    plant = await Plant().online()
    began_s = plant.clock.now_s()

    await plant.dispatcher.settle(["pump-1", "pump-2"], within_s=15.0)

    assert plant.clock.now_s() == began_s


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
