"""What is published after a crash, and that nothing is carried out twice."""

from __future__ import annotations

import asyncio

import pytest

from gateway.records import AuditRecord, EventRecord, Phase, ResultRecord
from gateway.storage.journal import Remembered
from tests.starters.fakes import AT_SPEED, READY, TRANSACTION_S, VB01
from tests.starters.journal_rig import rig_online
from tests.starters.rig import virtually

# A crash at every moment of a start's life: the start frame goes out at most once per id, whatever follows.
MOMENTS_S = [round(TRANSACTION_S * step / 4, 4) for step in range(40)]


@pytest.mark.parametrize("second_s", [0.0, 0.001, 0.1, 1.0, 9.99, 10.001, 11.0])
@virtually
async def test_killed_again_while_it_recovers_it_still_publishes_the_end_once(second_s: float) -> None:
    rig = await rig_online()
    rig.submit("start", "1")
    await rig.until_written()
    rig.crash()
    rig.lose()  # so that the first recovery waits for a status
    rig.restart()
    await asyncio.sleep(second_s)
    rig.crash()
    finals = [each for each in rig.sink.of(ResultRecord) if each.phase.is_final]

    rig.restart()
    await asyncio.sleep(15.0)
    finals += [each for each in rig.sink.of(ResultRecord) if each.phase.is_final]

    assert [(each.id, each.phase, each.code, each.is_duplicate) for each in finals] == [
        ("1", Phase.UNCONFIRMED, "crashed", False)
    ]
    assert rig.starts() == 1


@virtually
async def test_an_intent_without_outcome_is_published_once_with_the_state_and_never_carried_out() -> None:
    rig = await rig_online()
    rig.submit("start", "1", operator="Alice A.")
    await rig.until_written()
    rig.crash()
    rig.poll()

    rig.restart()
    await asyncio.sleep(15.0)
    first = rig.sink.final("1")
    events = rig.sink.events()
    decisions = [(audit.decision, audit.code, audit.id) for audit in rig.sink.of(AuditRecord)]
    rig.crash()
    rig.restart()
    await asyncio.sleep(15.0)
    again = rig.sink.of(ResultRecord)
    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert (first.phase, first.code, first.values) == (Phase.UNCONFIRMED, "crashed", {"state": "running"})
    assert not first.is_duplicate
    assert "the starter is now running" in first.text
    assert events == ["command_cut_short"]
    assert decisions == [("unconfirmed", "crashed", "1")]
    assert again == []
    assert rig.starts() == 1
    assert rig.sink.of(ResultRecord)[-1].is_duplicate


@virtually
async def test_a_command_cut_short_before_its_intent_was_stored_wrote_nothing_and_says_so() -> None:
    rig = await rig_online()
    rig.submit("start", "1")
    await asyncio.sleep(TRANSACTION_S)
    rig.crash()

    rig.restart()
    await asyncio.sleep(15.0)

    final = rig.sink.final("1")
    assert (final.phase, final.code) == (Phase.REJECTED, "crashed")
    assert "nothing was written" in final.text
    assert rig.sink.events() == []
    assert rig.starts() == 0


@virtually
async def test_a_stop_cut_short_is_unconfirmed_and_can_be_sent_again_at_once() -> None:
    rig = await rig_online()
    rig.unit.holding[VB01] = AT_SPEED
    rig.submit("stop", "1")
    await asyncio.sleep(TRANSACTION_S / 2)
    rig.crash()
    rig.lose()

    rig.restart()
    rig.submit("stop", "1")
    await asyncio.sleep(20.0)

    phases = rig.sink.phases("1")
    assert ("unconfirmed", "crashed") in phases
    assert ("confirmed", "ok") in phases
    assert rig.disk.stored["alice", "1"].result.phase is Phase.CONFIRMED
    assert not rig.unit.holding[VB01] & 1


@virtually
async def test_the_report_of_a_crash_waits_for_the_first_status_but_not_for_ever() -> None:
    rig = await rig_online()
    rig.submit("start", "1")
    await rig.until_written()
    rig.crash()
    rig.lose()

    rig.restart()
    await asyncio.sleep(9.0)
    early = rig.sink.of(ResultRecord)
    rig.submit("start", "1")  # meanwhile the ledger answers with what is known already
    await asyncio.sleep(2.0)

    repeated, final = rig.sink.of(ResultRecord)
    assert early == []
    assert (repeated.phase, repeated.code, repeated.is_duplicate) == (Phase.UNCONFIRMED, "crashed", True)
    assert (final.phase, final.code, final.values) == (Phase.UNCONFIRMED, "crashed", {})
    assert "not known yet" in final.text


@virtually
async def test_closing_hurries_the_report_of_a_crash() -> None:
    rig = await rig_online()
    rig.submit("start", "1")
    await rig.until_written()
    rig.crash()
    rig.lose()
    rig.restart()
    began_s = rig.clock.now_s()

    await rig.dispatcher.close()
    await asyncio.sleep(1.0)

    assert rig.sink.final("1").code == "crashed"
    assert rig.clock.now_s() - began_s < 2.0


@virtually
async def test_a_command_for_a_starter_that_is_configured_no_more_is_ended_too() -> None:
    rig = await rig_online()
    gone = ResultRecord("pump-9", "alice", "1", "start", Phase.ACCEPTED, "ok", "", 0.0)

    rig.dispatcher.recall([Remembered(gone, may_be_written=True)])
    await asyncio.sleep(1.0)

    assert rig.sink.final("1").code == "crashed"
    assert rig.sink.of(EventRecord) == []


@virtually
async def test_what_came_before_the_ledger_could_be_read_is_not_overwritten_by_it() -> None:
    rig = await rig_online()
    rig.unit.holding[VB01] = AT_SPEED
    old = ResultRecord("pump-1", "alice", "1", "start", Phase.WRITTEN, "ok", "", 0.0)
    rig.submit("stop", "1")

    rig.dispatcher.recall([Remembered(old, may_be_written=True)])
    await asyncio.sleep(20.0)

    assert {result.verb for result in rig.sink.of(ResultRecord)} == {"stop"}


@pytest.mark.parametrize("takes_s", [0.0, 0.015, 0.3])
@virtually
async def test_at_most_one_start_frame_per_id_goes_out_whenever_the_gateway_crashes(takes_s: float) -> None:
    for moment_s in MOMENTS_S:
        rig = await rig_online(takes_s=takes_s)
        finals: list[ResultRecord] = []
        rig.submit("start", "1")
        await asyncio.sleep(moment_s)
        accepted = rig.sink.of(ResultRecord)
        finals += [r for r in accepted if r.phase.is_final]
        rig.crash()
        await asyncio.sleep(1.0)
        rig.poll()
        before = rig.starts()

        rig.restart()
        await asyncio.sleep(12.0)
        rig.submit("start", "1")
        await asyncio.sleep(12.0)
        finals += [r for r in rig.sink.of(ResultRecord) if r.phase.is_final and not r.is_duplicate]

        assert rig.starts() <= 1, moment_s
        assert len(finals) == 1, (moment_s, finals)
        if before:
            assert finals[0].phase in (Phase.CONFIRMED, Phase.UNCONFIRMED), moment_s


@pytest.mark.parametrize("is_running", [True, False])
@virtually
async def test_a_stop_without_an_id_that_a_crash_cuts_short_is_reported_once_after_the_restart(
    is_running: bool,
) -> None:
    rig = await rig_online()
    rig.unit.holding[VB01] = AT_SPEED
    rig.poll()
    rig.unit.on_write = lambda _: None
    rig.submit("stop", None)
    await asyncio.sleep(1.0)
    rig.crash()
    rig.unit.holding[VB01] = AT_SPEED if is_running else READY
    rig.poll()

    rig.restart()
    await asyncio.sleep(15.0)

    (final,) = rig.sink.of(ResultRecord)
    assert (final.id, final.verb, final.phase, final.code) == (None, "stop", Phase.UNCONFIRMED, "crashed")
    assert final.values == {"state": "running" if is_running else "ready"}
    (event,) = [each for each in rig.sink.of(EventRecord) if each.code == "command_cut_short"]
    assert event.data["verb"] == "stop"
    rig.crash()
    rig.restart()
    await asyncio.sleep(15.0)
    assert rig.sink.of(ResultRecord) == []


@virtually
async def test_a_stop_without_an_id_that_has_ended_is_not_reported_after_a_crash() -> None:
    rig = await rig_online()
    rig.submit("stop", None)
    await asyncio.sleep(5.0)
    rig.crash()

    rig.restart()
    await asyncio.sleep(15.0)

    assert rig.sink.of(ResultRecord) == []
