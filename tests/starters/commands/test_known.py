"""What the answer to a repetition says."""

from __future__ import annotations

import asyncio

from gateway.records import Phase, ResultRecord
from gateway.starters.commands.ledger import STAYS_REFUSED
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from tests.starters.plant import Plant
from tests.starters.rig import CommandRig, virtually


@virtually
async def test_a_refusal_stands_for_its_id_even_when_its_cause_is_gone_and_the_answer_says_so() -> None:
    rig = CommandRig()  # it is not identified yet
    rig.telemetry.start()
    rig.poll()
    rig.submit("start", "1")
    await asyncio.sleep(1.0)
    rig.poll()

    rig.submit("start", "1")
    rig.submit("start", "2")
    await asyncio.sleep(3.0)

    first, again = (each for each in rig.sink.of(ResultRecord) if each.id == "1")
    assert (first.phase, first.code, first.is_duplicate) == (Phase.REJECTED, "identity_unknown", False)
    assert (again.phase, again.code, again.is_duplicate) == (Phase.REJECTED, "identity_unknown", True)
    assert again.text == f"{first.text}; {STAYS_REFUSED}"
    assert rig.sink.final("2").phase is Phase.CONFIRMED
    assert rig.starts() == 1


@virtually
async def test_the_end_of_a_command_that_was_carried_out_is_published_again_word_by_word() -> None:
    plant = await Plant().online()
    assert await plant.do("start") == "ok"

    plant.submit("start")

    first, again = (each for each in plant.sink.of(ResultRecord) if each.phase.is_final)
    assert (again.text, again.is_duplicate) == (first.text, True)


@virtually
async def test_what_was_too_much_stays_refused_and_is_taken_with_a_new_id() -> None:
    policy = PolicySettings(limits=RateLimits(under_way_on_line=1))
    plant = await Plant(None, "a@x", "b@x", policy=policy).online()
    plant.submit("start", "1", starter="a")
    plant.submit("start", "2", starter="b")
    await plant.wait(3.0)
    assert plant.sink.final("2").code == "too_many"
    plant.sink.clear()

    assert await plant.do("start", "2", starter="b") == "too_many"
    assert await plant.do("start", "3", starter="b") == "ok"
    assert plant.starts("b") == 1
