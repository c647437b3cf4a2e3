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
from tests.starters.rules import ACCEPTED, CONFIRMED, WRITTEN, ignore

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
async def test_all_members_are_stopped_at_once_and_the_whole_is_confirmed_when_all_are() -> None:
    plant = await running()

    plant.submit("stop", "1", starter="hall")
    await plant.wait(3.0)

    for name in ("pump-1", "pump-2", "pump-3", "hall"):
        assert phases(plant, name) == [ACCEPTED, WRITTEN, CONFIRMED], name
    first_s = [machine.line.sent[0].at_s for machine in plant.machines.values()]
    assert len(set(first_s)) == 1
    results = plant.sink.of(ResultRecord)
    assert {r.id for r in results} == {"1"}
    assert results[-1].starter == "hall"
    assert results[-1].values["members"]["pump-2"] == {"phase": "confirmed", "code": "ok"}


@virtually
async def test_one_member_that_does_not_stop_leaves_the_whole_unconfirmed() -> None:
    plant = await running()
    plant.machines["pump-2"].unit.on_write = ignore

    plant.submit("stop", "1", starter="hall")
    await plant.wait(15.0)

    whole = [r for r in plant.sink.of(ResultRecord) if r.starter == "hall"][-1]
    assert (whole.phase, whole.code) == (Phase.UNCONFIRMED, "not_all")
    assert whole.text.startswith("1 of 3 not confirmed: pump-2: not_seen")
    assert "the motor may be turning" in whole.text
    assert phases(plant, "pump-1")[-1] == CONFIRMED


@virtually
async def test_a_repeated_group_stop_is_done_again() -> None:
    plant = await running()
    plant.submit("stop", "1", starter="hall")
    await plant.wait(3.0)
    plant.machines["pump-1"].set_motor(is_on=True)

    plant.submit("stop", "1", starter="hall")
    await plant.wait(3.0)

    assert plant.stops("pump-1") >= 2
    assert plant.sink.of(ResultRecord)[-1].is_duplicate


@virtually
async def test_a_members_result_does_not_stand_in_the_way_of_the_groups_id() -> None:
    plant = await running()
    plant.submit("stop", "1", starter="hall")
    plant.submit("stop", "1", starter="hall")
    await plant.wait(3.0)

    duplicates = [(r.starter, r.phase) for r in plant.sink.of(ResultRecord) if r.is_duplicate]
    assert duplicates == [("hall", Phase.ACCEPTED)]


@virtually
async def test_members_that_a_client_may_not_stop_are_refused_and_the_others_stopped() -> None:
    plant = await running()

    plant.submit("stop", "1", starter="hall", client="victor")
    await plant.wait(3.0)

    assert phases(plant, "pump-1")[-1] == CONFIRMED
    assert phases(plant, "pump-2") == phases(plant, "pump-3") == [("rejected", "not_allowed")]
    assert phases(plant, "hall")[-1] == ("unconfirmed", "not_all")
    assert plant.stops("pump-2") == 0


@virtually
async def test_who_may_stop_no_member_may_not_stop_the_group() -> None:
    plant = await running()

    plant.submit("stop", "1", starter="hall", client="mallory")

    assert plant.sink.phases() == [("rejected", "not_allowed")]


@pytest.mark.parametrize("verb", ["start", "reset", "lock", "select", "read"])
@virtually
async def test_no_other_verb_works_on_a_group(verb: str) -> None:
    plant = await running()

    plant.submit(verb, "1", starter="hall")

    assert plant.sink.phases() == [("rejected", "group_only_stop")]


@virtually
async def test_a_group_stop_cuts_the_members_starts() -> None:
    plant = await Plant(policy=HALL).online()
    for name in plant.machines:
        plant.submit("start", name, starter=name)

    plant.submit("stop", "1", starter="hall")
    await plant.wait(3.0)

    assert {plant.sink.final(name).code for name in plant.machines} == {"stopped_first"}
    assert sum(map(plant.starts, plant.machines)) == 0


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
