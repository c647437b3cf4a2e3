"""What stands between a command and its first write, whatever stood before it."""

from __future__ import annotations

import asyncio

import pytest

from gateway.errors import CommandError
from gateway.records import LockRecord, StateRecord
from gateway.starters.policy.preconditions import Guard
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.start_rules import RuleSet
from tests.starters.plant import Plant
from tests.starters.rig import virtually

LOCK = LockRecord("alice", 0.0, "belt is off")


def guard(plant: Plant, verb: str, *, expires_s: float | None = None) -> Guard:
    return plant.policy.guard(
        CommandRequest("pump-1", "alice", verb, "1", received_s=0.0, expires_s=expires_s), ()
    )


@virtually
async def test_a_lock_set_since_the_command_was_accepted_stops_it() -> None:
    plant = Plant()
    starting, reading = guard(plant, "start"), guard(plant, "read")
    plant.policy.motor_history.set_lock("pump-1", LOCK)

    await reading.admit()
    with pytest.raises(CommandError) as caught:
        await starting.admit()

    assert caught.value.code == "locked"
    assert plant.policy.motor_history.starts_since("pump-1", -1.0) == []


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


@virtually
async def test_a_lock_of_a_starter_that_was_never_read_is_published_with_its_first_state() -> None:
    plant = Plant()
    plant.policy.motor_history.set_lock("pump-1", LOCK)
    plant.machines["pump-1"].telemetry.republish_state()
    assert plant.sink.of(StateRecord) == []

    plant.machines["pump-1"].telemetry.start()

    assert plant.locks() == ["alice"]
    await plant.machines["pump-1"].telemetry.close()
