"""An id is carried out once, however often it comes."""

from __future__ import annotations

import asyncio

from gateway.records import Phase, ResultRecord
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from tests.starters.plant import Plant
from tests.starters.rig import CommandRig, virtually


@virtually
async def test_an_id_that_was_refused_as_too_many_is_not_carried_out_later() -> None:
    rig = CommandRig()
    await rig.online()
    for number in range(20):  # as many as one starter takes at once
        rig.submit("read", f"{number}", args={"parameter": "P003"})

    rig.submit("start", "late")
    await asyncio.sleep(60.0)
    late = rig.sink.final("late")
    rig.submit("start", "late")
    await asyncio.sleep(5.0)

    assert (late.phase, late.code) == (Phase.REJECTED, "too_many")
    assert rig.sink.of(ResultRecord)[-1].is_duplicate
    assert rig.starts() == 0


@virtually
async def test_too_many_stops_with_an_id_that_has_a_result_get_no_other_end() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("stop", "known")
    await asyncio.sleep(5.0)
    rig.sink.clear()

    for number in range(20):
        rig.submit("stop", f"{number}")
    rig.submit("stop", "known")
    await asyncio.sleep(5.0)

    known = [result for result in rig.sink.of(ResultRecord) if result.id == "known"]
    assert not [result for result in known if result.code == "too_many"]
    assert "too_many" in {result.code for result in rig.sink.of(ResultRecord)}


@virtually
async def test_a_full_ledger_refuses_all_but_stops_until_its_first_proof_is_over() -> None:
    rig = CommandRig()
    await rig.online()
    rig.dispatcher._ledger._most_entries = 3
    for number in range(3):
        rig.submit("lock", f"{number}", args={"reason": "belt is off"})
        await asyncio.sleep(4.0)

    codes = []
    for id_, verb in (("full", "read"), ("down", "stop"), ("later", "read")):
        rig.submit(verb, id_, args={"parameter": "P003"} if verb == "read" else {})
        await asyncio.sleep(60.0 if id_ == "down" else 3.0)
        codes.append(rig.sink.final(id_).code)
    assert codes == ["ledger_full", "ok", "ok"]


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
