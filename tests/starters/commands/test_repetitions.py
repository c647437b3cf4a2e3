"""An id is carried out once, however often it comes."""

from __future__ import annotations

import asyncio

from gateway.records import AuditRecord, Phase, ResultRecord
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Rights
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

    rig.dispatcher.reject(CommandRequest("pump-1", "alice", "start", "1"), "expired", "too old")

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

    rig.dispatcher.reject(CommandRequest("pump-1", "alice", "start", "1"), "expired", "too old")

    (result,) = rig.sink.of(ResultRecord)
    assert (result.phase, result.is_duplicate) == (Phase.CONFIRMED, True)


@virtually
async def test_a_rejected_form_with_a_known_id_of_another_command_keeps_its_own_code() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(5.0)
    rig.sink.clear()

    rig.dispatcher.reject(CommandRequest("pump-1", "alice", "reset", "1"), "expired", "too old")

    assert rig.sink.phases() == [("rejected", "expired")]


@virtually
async def test_a_command_rejected_for_its_form_may_be_sent_again_in_good_form() -> None:
    rig = CommandRig()
    await rig.online()
    rig.dispatcher.reject(CommandRequest("pump-1", "alice", "start", "1"), "bad_payload", "no args")

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert rig.sink.of(ResultRecord)[-1].phase is Phase.CONFIRMED


@virtually
async def test_a_command_whose_proof_was_refused_is_not_carried_out_when_a_copy_of_it_proves_itself() -> None:
    rig = CommandRig()
    await rig.online()
    text = "issued_at is 9.0 s in the future"
    rig.dispatcher.reject(CommandRequest("pump-1", "alice", "start", "1"), "not_fresh", text)
    await asyncio.sleep(9.0)

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert rig.starts() == 0
    assert rig.sink.phases() == [("rejected", "not_fresh"), ("rejected", "not_fresh")]
    assert rig.sink.of(ResultRecord)[-1].is_duplicate


@virtually
async def test_one_id_sent_three_hundred_times_has_one_end_and_never_another() -> None:
    rig = CommandRig()
    await rig.online()

    for number in range(300):
        rig.submit("start", "1")
        await asyncio.sleep(0.01 if number % 2 else 0.0)
    await asyncio.sleep(5.0)

    finals = [result for result in rig.sink.of(ResultRecord) if result.phase.is_final]
    assert {(result.id, result.phase, result.code) for result in finals} == {("1", Phase.CONFIRMED, "ok")}
    assert [result.is_duplicate for result in finals].count(False) == 1
    assert rig.starts() == 1


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
async def test_a_client_that_has_lost_its_right_still_gets_the_result_of_its_command() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    rig.submit("stop", "2")
    await asyncio.sleep(5.0)
    ends = {id_: rig.sink.final(id_).code for id_ in ("1", "2")}
    rig.dispatcher.apply_rights(Rights([]))
    rig.sink.clear()
    frames = len(rig.line.writes)

    rig.submit("start", "1")
    rig.submit("stop", "2")
    await asyncio.sleep(5.0)

    assert {result.id: result.code for result in rig.sink.of(ResultRecord)} == ends
    assert all(result.is_duplicate for result in rig.sink.of(ResultRecord))
    assert len(rig.line.writes) == frames


@virtually
async def test_what_is_refused_under_the_id_of_another_command_counts_as_a_duplicate() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    rig.submit("reset", "1")
    await asyncio.sleep(1.0)

    finals = [result for result in rig.sink.of(ResultRecord) if result.phase.is_final]
    assert [(result.code, result.is_duplicate) for result in finals] == [("ok", False), ("id_reused", True)]


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
async def test_a_copy_of_a_start_is_answered_with_the_starts_end_also_after_a_stop_with_the_same_id() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")
    await asyncio.sleep(5.0)
    rig.submit("stop", "1")
    await asyncio.sleep(5.0)
    rig.sink.clear()

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    (result,) = rig.sink.of(ResultRecord)
    assert (result.verb, result.phase, result.is_duplicate) == ("start", Phase.CONFIRMED, True)
    assert rig.starts() == 1
