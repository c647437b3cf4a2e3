"""The gateway's own rules on the way of a command: judged, counted and stored before anything is written."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.records import EventRecord, Phase, Severity
from gateway.starters.policy.rights import Operator
from gateway.starters.policy.start_rules import RuleSet
from tests.starters.fakes import AT_SPEED, VB01
from tests.starters.plant import FakeMemory, Plant
from tests.starters.rig import virtually

PAUSE = RuleSet(minimum_pause_s=60.0)


@virtually
async def test_without_rules_a_motor_may_be_started_as_often_as_it_is_stopped() -> None:
    plant = await Plant().online()

    for number in range(20):
        assert await plant.do("start", f"start {number}") == "ok"
        assert await plant.do("stop", f"stop {number}") == "ok"

    assert plant.starts() == 20


@virtually
async def test_a_start_too_many_is_refused_by_the_name_of_its_rule_and_with_the_reading() -> None:
    plant = await Plant({"pump-1": RuleSet(starts_per_hour=1)}).online()
    await plant.do("start", "1")
    await plant.do("stop", "2")

    assert await plant.do("start", "3") == "too_many_starts"

    final = plant.sink.final("3")
    assert final.phase is Phase.REJECTED
    assert "1 in the last hour, of 1" in final.text
    assert plant.starts() == 1


@virtually
async def test_local_starts_count_as_well() -> None:
    plant = await Plant({"pump-1": RuleSet(starts_per_hour=1)}).online()
    plant.machines["pump-1"].set_motor(is_on=True)
    plant.machines["pump-1"].set_motor(is_on=False)

    assert await plant.do("start") == "too_many_starts"


@virtually
async def test_a_stop_begins_the_pause_before_the_next_start() -> None:
    plant = await Plant({"pump-1": PAUSE}).online()
    await plant.wait(60.0)
    assert await plant.do("start", "1") == "ok"
    await plant.do("stop", "2")

    assert await plant.do("start", "3") == "pause_too_short"
    await plant.wait(60.0)
    assert await plant.do("start", "4") == "ok"


@virtually
async def test_starters_of_a_feeder_on_different_lines_do_not_start_together() -> None:
    on_a = RuleSet(feeder="a", stagger_s=10.0)
    plant = await Plant({"pump-1": on_a, "pump-2": on_a}).online()

    plant.submit("start", "1", starter="pump-1")
    plant.submit("start", "2", starter="pump-2")
    plant.submit("start", "3", starter="pump-3")
    await plant.wait(5.0)

    assert sorted(plant.sink.final(id_).code for id_ in "12") == ["feeder_busy", "ok"]
    assert plant.starts("pump-1") + plant.starts("pump-2") == 1
    assert plant.sink.final("3").code == "ok"
    await plant.wait(10.0)
    late = "pump-1" if plant.starts("pump-1") == 0 else "pump-2"
    assert await plant.do("start", "4", starter=late) == "ok"


@virtually
async def test_starts_and_standstill_outlive_the_gateway() -> None:
    rules = {"pump-1": RuleSet(starts_per_hour=1), "pump-2": PAUSE}
    before = await Plant(rules).online()
    await before.do("start", "1")
    await before.do("stop", "2")
    await before.wait(60.0)
    await before.dispatcher.close()

    after = await Plant(rules, memory=FakeMemory(before.memory.document)).online()

    assert await after.do("start", "3") == "too_many_starts"
    assert await after.do("start", "4", starter="pump-2") == "ok"


@virtually
async def test_where_nothing_is_known_the_pause_begins_when_the_motor_is_first_seen_to_stand() -> None:
    plant = await Plant({"pump-1": PAUSE}).online()

    assert await plant.do("start", "1") == "pause_too_short"
    await plant.wait(60.0)
    assert await plant.do("start", "2") == "ok"


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
async def test_a_damaged_memory_locks_what_can_be_locked_and_says_so() -> None:
    memory = FakeMemory()
    memory.is_damaged = True
    operators = (Operator("alice", ("*",), ("pump-1",)), Operator("bob", ("start",), ("*",)))
    plant = Plant(memory=memory, operators=operators)
    (event,) = plant.sink.of(EventRecord)
    await plant.online()

    assert (event.code, event.severity) == ("memory_damaged", Severity.ERROR)
    assert "1 starters are locked" in event.text
    assert memory.set_asides == 1
    assert await plant.do("start", "1") == "locked"
    assert await plant.do("start", "2", starter="pump-2", client="bob") == "ok"
    assert await plant.do("unlock", "3") == "ok"
    assert await plant.do("start", "4") == "ok"


@virtually
async def test_a_memory_of_another_shape_is_damaged() -> None:
    plant = Plant(memory=FakeMemory({"version": 7}))

    assert [event.code for event in plant.sink.of(EventRecord)] == ["memory_damaged"]


@pytest.mark.parametrize(
    ("expect", "code"),
    [
        ({"state": "ready"}, "ok"),
        ({"state": "ready", "speed": 3}, "bad_expect"),
        ({"remote": True, "running": False}, "ok"),
        ({"state": "running"}, "not_as_expected"),
        ({"state": "gone"}, "bad_expect"),
    ],
)
@virtually
async def test_a_start_is_only_written_while_things_are_as_its_operator_expects(
    expect: dict[str, Any], code: str
) -> None:
    plant = await Plant().online()

    assert await plant.do("start", expect=expect) == code

    assert plant.starts() == (code == "ok")


@virtually
async def test_expectations_are_judged_on_what_is_read_then_and_not_on_what_was() -> None:
    plant = await Plant().online()
    plant.machines["pump-1"].unit.holding[VB01] = AT_SPEED  # not yet polled

    code = await plant.do("read", args={"parameter": "P003"}, expect={"state": "ready"})

    assert code == "not_as_expected"


@virtually
async def test_a_command_that_has_waited_too_long_is_not_written_any_more() -> None:
    plant = await Plant().online()
    plant.submit("start", expires_s=plant.clock.now_s() + 0.01)
    await plant.wait(3.0)

    final = plant.sink.final("1")
    assert (final.phase, final.code) == (Phase.REJECTED, "expired")
    assert plant.starts() == 0


@virtually
async def test_a_start_that_is_written_is_still_read_back_when_a_lock_comes() -> None:
    plant = await Plant().online()
    plant.submit("start", "1", client="bob")
    await asyncio.sleep(0.15)
    assert plant.starts() == 1

    plant.submit("lock", "2", args={"reason": "belt is off"})
    await plant.wait(3.0)

    assert plant.sink.final("1").code == "ok"
