"""An id is carried out once, however often it comes."""

from __future__ import annotations

import asyncio

from gateway.starters.records import AuditRecord, Phase, ResultRecord
from gateway.starters.request import CommandRequest
from tests.starters.rig import CommandRig, virtually


@virtually
async def test_a_repeated_id_gets_the_stored_result_and_is_not_carried_out() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(5.0)
    rig.sink.clear()

    rig.submit("start", "1", correlation=b"again")
    await asyncio.sleep(5.0)

    (result,) = rig.sink.of(ResultRecord)
    assert (result.phase, result.is_duplicate, result.correlation) == (Phase.CONFIRMED, True, b"again")
    assert rig.starts() == 1
    assert [audit.decision for audit in rig.sink.of(AuditRecord)] == ["duplicate"]


@virtually
async def test_a_rejected_command_is_not_carried_out_when_it_is_repeated() -> None:
    rig = CommandRig()
    await rig.online()
    rig.lose()
    rig.submit("start", "1")
    rig.poll()
    await asyncio.sleep(5.0)
    rig.poll()

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert rig.starts() == 0
    assert rig.sink.of(ResultRecord)[-1].is_duplicate


@virtually
async def test_the_same_id_of_another_client_is_another_command() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("stop", "1", client="alice")
    await asyncio.sleep(5.0)
    rig.sink.clear()

    rig.submit("stop", "1", client="victor")
    await asyncio.sleep(5.0)

    assert not any(result.is_duplicate for result in rig.sink.of(ResultRecord))


@virtually
async def test_an_id_that_stood_for_another_command_is_refused() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("read", "1", args={"parameter": "P003"})
    await asyncio.sleep(5.0)
    rig.sink.clear()

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [("rejected", "id_reused")]
    assert rig.starts() == 0


@virtually
async def test_a_command_that_was_unfit_to_be_submitted_is_rejected_and_audited() -> None:
    rig = CommandRig()
    await rig.online()

    rig.commander.reject(CommandRequest("pump-1", "alice", "start", "1"), "expired", "too old")

    assert rig.sink.phases() == [("rejected", "expired")]
    (audit,) = rig.sink.of(AuditRecord)
    assert (audit.client, audit.decision, audit.code) == ("alice", "rejected", "expired")


@virtually
async def test_a_late_redelivery_of_a_command_gets_the_first_ones_result() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(5.0)
    rig.sink.clear()

    rig.commander.reject(CommandRequest("pump-1", "alice", "start", "1"), "expired", "too old")

    (result,) = rig.sink.of(ResultRecord)
    assert (result.phase, result.is_duplicate) == (Phase.CONFIRMED, True)


@virtually
async def test_a_rejected_form_with_a_known_id_of_another_command_keeps_its_own_code() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(5.0)
    rig.sink.clear()

    rig.commander.reject(CommandRequest("pump-1", "alice", "reset", "1"), "expired", "too old")

    assert rig.sink.phases() == [("rejected", "expired")]


@virtually
async def test_a_command_rejected_for_its_form_may_be_sent_again_in_good_form() -> None:
    rig = CommandRig()
    await rig.online()
    rig.commander.reject(CommandRequest("pump-1", "alice", "start", "1"), "not_fresh", "no clock")

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert rig.sink.of(ResultRecord)[-1].phase is Phase.CONFIRMED
