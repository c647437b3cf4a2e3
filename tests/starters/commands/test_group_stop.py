"""One stop for a group: every member on its own line, each with its result, and one for the whole."""

from __future__ import annotations

import asyncio

import pytest

from gateway.line.rtu.outcome import Outcome, Refused, Silent
from gateway.records import Phase, ResultRecord
from gateway.starters.policy.start_rules import PolicySettings
from tests.starters.fakes import AT_SPEED, READY, VB01
from tests.starters.plant import Plant
from tests.starters.rig import virtually
from tests.starters.rules import ACCEPTED, CONFIRMED, WRITTEN

HALL = PolicySettings(groups={"hall": ("pump-1", "pump-2", "pump-3")})


async def running() -> Plant:
    plant = await Plant(policy=HALL).online()
    for machine in plant.machines.values():
        machine.set_motor(is_on=True)
    plant.sink.clear()
    return plant


def phases(plant: Plant, name: str) -> list[tuple[str, str]]:
    return [(r.phase.value, r.code) for r in plant.sink.of(ResultRecord) if r.starter == name]


@virtually
async def test_a_members_result_does_not_stand_in_the_way_of_the_groups_id() -> None:
    plant = await running()
    plant.submit("stop", "1", starter="hall")
    plant.submit("stop", "1", starter="hall")
    await plant.wait(3.0)

    duplicates = [(r.starter, r.phase) for r in plant.sink.of(ResultRecord) if r.is_duplicate]
    assert duplicates == [("hall", Phase.ACCEPTED)]


@virtually
async def test_a_group_whose_lines_are_all_down_is_not_called_stopped() -> None:
    plant = await running()
    with plant.machines["pump-1"].line.silence(), plant.machines["pump-2"].line.silence():
        plant.submit("stop", "1", starter="hall")
        await asyncio.sleep(0.2)
        await plant.dispatcher.close()

    assert [r.phase for r in plant.sink.of(ResultRecord) if r.starter == "hall"][-1] is Phase.UNCONFIRMED


@virtually
async def test_a_group_stop_at_the_end_of_the_gateway_is_rejected_as_a_whole() -> None:
    plant = await running()
    await plant.dispatcher.close()

    plant.submit("stop", "1", starter="hall")

    assert plant.sink.phases("1") == [("rejected", "shutting_down")]


@pytest.mark.parametrize("outcome", [Silent("no port", is_sent=False), Refused(2, at_s=0.0)])
@virtually
async def test_a_group_to_which_nothing_could_be_written_is_not_called_stopped(outcome: Outcome) -> None:
    plant = await running()
    for machine in plant.machines.values():
        machine.line.rules.append(lambda request: outcome if request.is_write else None)

    plant.submit("stop", "1", starter="hall")
    await plant.wait(15.0)

    phase = "failed" if isinstance(outcome, Refused) else "rejected"
    assert phases(plant, "hall") == [ACCEPTED, (phase, "not_all")]
    assert len([r for r in plant.sink.of(ResultRecord) if r.phase.is_final]) == 4


@virtually
async def test_only_the_first_few_members_that_did_not_stop_are_named_in_words() -> None:
    names = tuple(f"p{number}" for number in range(7))
    plant = await Plant(None, *names, policy=PolicySettings(groups={"hall": names})).online()

    plant.submit("stop", "1", starter="hall")
    await plant.dispatcher.close()

    text = plant.sink.of(ResultRecord)[-1].text
    assert text.startswith("7 of 7 not confirmed: p0: shutting_down")
    assert text.endswith("; and 2 more")


@virtually
async def test_a_group_stop_without_an_id_that_is_sent_again_is_answered_once() -> None:
    plant = await running()
    for _ in range(50):
        plant.submit("stop", None, starter="hall")
    await plant.wait(3.0)

    assert phases(plant, "hall") == [ACCEPTED, WRITTEN, CONFIRMED]
    assert {machine.unit.holding[VB01] for machine in plant.machines.values()} == {READY}
    assert AT_SPEED != READY
