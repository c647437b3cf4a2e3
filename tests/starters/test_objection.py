"""Why a command would be refused now: the page shows what the same command would be answered."""

from __future__ import annotations

import random

import pytest

from gateway.records import LockRecord
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.start_rules import RuleSet
from tests.starters.fakes import FAULT, READY, VB01
from tests.starters.plant import Plant
from tests.starters.rig import virtually


def objection(
    plant: Plant, verb: str, *, client: str = "alice", starter: str = "pump-1", **args: object
) -> str:
    request = CommandRequest(starter, client, verb, "-", args, received_s=plant.clock.now_s())
    error = plant.dispatcher.objection(request)
    return "" if error is None else error.code


@virtually
async def test_asking_does_nothing_reads_nothing_and_counts_nothing() -> None:
    plant = await Plant({"pump-1": RuleSet(starts_per_hour=1)}).online()

    for _ in range(1000):
        assert objection(plant, "start") == ""

    assert plant.machines["pump-1"].line.sent == []
    assert plant.sink.records == []
    assert await plant.do("start", "1") == "ok"


@virtually
async def test_rights_faults_locks_and_rules_are_named_by_their_codes() -> None:
    rules = {"pump-1": RuleSet(starts_per_hour=1), "pump-2": RuleSet(two_step=frozenset({"start"}))}
    plant = await Plant(rules).online()

    assert objection(plant, "start", client="victor") == "not_allowed"
    assert objection(plant, "stop", client="victor") == ""
    assert objection(plant, "reset") == "no_fault_to_reset"
    assert objection(plant, "start", starter="pump-2") == "", "a command in two steps counts as selected"
    assert objection(plant, "start", starter="pump-9") == "unknown_starter"
    assert objection(plant, "fly") == "unknown_verb"
    assert objection(plant, "unlock") == "not_locked"
    assert await plant.do("start", "1") == "ok"
    assert objection(plant, "start") == "motor_running"
    assert await plant.do("stop", "2") == "ok"
    assert objection(plant, "start") == "too_many_starts"
    plant.policy.motor_history.set_lock("pump-3", LockRecord("bob", 0.0, "belt is off"))
    assert objection(plant, "start", starter="pump-3") == "locked"
    plant.machines["pump-2"].unit.holding[VB01] = READY | FAULT
    plant.poll()
    assert objection(plant, "start", starter="pump-2") == "fault_active"


@pytest.mark.long
@virtually
async def test_whatever_has_happened_the_command_itself_is_answered_as_was_said() -> None:
    chance = random.Random(16)
    plant = await Plant({"pump-1": RuleSet(starts_per_hour=3, minimum_pause_s=5.0)}).online()
    unit, logbook, seen = plant.machines["pump-1"].unit, plant.policy.motor_history, set()
    for n in range(150):
        event = chance.randrange(6)
        if event == 0:
            unit.holding[VB01] ^= FAULT
        elif event == 1:
            unit.holding[VB01] = READY
        elif event == 2:
            unit.holding[VB01] ^= 1 << chance.randrange(16)
        elif event == 3:
            logbook.set_lock("pump-1", LockRecord("bob", 0.0, "x") if chance.random() < 0.5 else None)
        await plant.wait(chance.choice((1.0, 4.0, 30.0)))
        verb, client = (
            chance.choice(("start", "reset", "start", "lock", "unlock")),
            chance.choice(("alice", "bob")),
        )
        args = {"reason": "x"} if verb == "lock" else {}

        said = objection(plant, verb, client=client, **args)
        plant.sink.clear()
        answered = await plant.do(verb, str(n), client=client, args=args)

        final = plant.sink.final(str(n))
        if said:
            assert (final.phase, answered) == ("rejected", said)
        else:
            assert final.phase != "rejected", f"{verb}: {answered}"
        seen.add(said)

    assert len(seen) >= 5, seen
