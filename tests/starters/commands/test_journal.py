"""What the dispatcher keeps, when, and what it says after a crash."""

from __future__ import annotations

import asyncio

import pytest

from gateway.records import Phase, ResultRecord
from gateway.storage.journal import UNAVAILABLE, NoJournal, Remembered
from tests.starters.fakes import AT_SPEED, TRANSACTION_S, VB01
from tests.starters.journal_rig import JournalRig, rig_online
from tests.starters.rig import virtually


@virtually
async def test_the_intent_is_stored_before_the_start_goes_out() -> None:
    rig = await rig_online()
    stored_at_write: list[Remembered] = []
    obey = rig.unit.on_write
    rig.unit.on_write = lambda request: (stored_at_write.extend(rig.disk.remembered()), obey(request))[1]

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert [(each.result.id, each.may_be_written) for each in stored_at_write] == [("1", True)]
    assert rig.sink.final("1").phase is Phase.CONFIRMED


@virtually
async def test_a_read_waits_for_no_disk() -> None:
    rig = await rig_online(takes_s=30.0)

    rig.submit("read", "1", args={"parameter": "P003"})
    await asyncio.sleep(1.0)

    assert rig.journal.intended == []
    assert len(rig.line.sent) > 0


@virtually
async def test_a_start_whose_intent_cannot_be_stored_is_refused_unwritten() -> None:
    rig = await rig_online()
    rig.journal.is_failing = True

    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    final = rig.sink.final("1")
    assert (final.phase, final.code) == (Phase.REJECTED, UNAVAILABLE)
    assert "nothing was written" in final.text
    assert rig.line.writes == []


@pytest.mark.parametrize("verb", ["start", "reset", "read", "set"])
@virtually
async def test_without_the_ledger_everything_but_stop_is_refused(verb: str) -> None:
    rig = await rig_online()
    rig.journal.trouble = "the disk is full"
    args = {"parameter": "P102", "value": 5} if verb == "set" else {"parameter": "P003"}

    rig.submit(verb, "1", args=args if verb in ("read", "set") else {})
    rig.submit("stop", "2")
    await asyncio.sleep(5.0)

    assert rig.sink.phases("1") == [("rejected", UNAVAILABLE)]
    assert rig.sink.final("2").phase is Phase.CONFIRMED
    assert len(rig.stops()) > 0


@virtually
async def test_a_command_refused_for_lack_of_the_ledger_stays_refused_and_a_new_id_is_taken() -> None:
    rig = await rig_online()
    rig.journal.trouble = "it has not been read yet"
    rig.submit("start", "1")
    rig.journal.trouble = ""

    rig.submit("start", "1")
    await asyncio.sleep(5.0)
    assert rig.sink.phases("1") == [("rejected", UNAVAILABLE), ("rejected", UNAVAILABLE)]
    assert rig.starts() == 0

    rig.submit("start", "2")
    await asyncio.sleep(5.0)
    assert rig.sink.phases("2")[-1] == ("confirmed", "ok")


@virtually
async def test_what_the_ledger_remembers_counts_more_than_a_refusal_of_before_it_was_read() -> None:
    rig = await rig_online()
    rig.submit("start", "1")
    await asyncio.sleep(5.0)
    rig.crash()
    rig.sink.clear()
    rig.begin_run()
    rig.journal.trouble = "it has not been read yet"
    rig.submit("start", "1")
    rig.journal.trouble = ""

    rig.dispatcher.recall(rig.disk.remembered())
    rig.submit("start", "1")
    await asyncio.sleep(5.0)

    assert rig.sink.phases("1") == [("rejected", UNAVAILABLE), ("confirmed", "ok")]
    assert rig.starts() == 1


@virtually
async def test_a_stop_waits_for_no_disk_and_its_result_neither() -> None:
    rig = await rig_online(takes_s=60.0)
    rig.unit.holding[VB01] = AT_SPEED

    rig.submit("stop", "1")
    await asyncio.sleep(5.0)

    assert rig.stops()[0].at_s < rig.clock.now_s() - 4.0
    assert rig.sink.final("1").phase is Phase.CONFIRMED


@virtually
async def test_a_stop_overtakes_a_start_that_waits_for_the_disk() -> None:
    rig = await rig_online(takes_s=0.9)
    rig.submit("start", "1")
    await asyncio.sleep(0.5)

    rig.submit("stop", "2")
    await asyncio.sleep(5.0)

    assert rig.sink.final("1").code == "stopped_first"
    assert rig.starts() == 0
    assert rig.sink.final("2").phase is Phase.CONFIRMED


@virtually
async def test_after_a_slow_disk_the_starter_is_read_again_before_it_is_written() -> None:
    rig = await rig_online(takes_s=0.9)
    rig.submit("start", "1")
    await asyncio.sleep(0.5)
    rig.unit.holding[VB01] = 0x4002  # someone switched it to local meanwhile

    await asyncio.sleep(5.0)

    assert rig.sink.final("1").code == "in_local"
    assert rig.line.writes == []


@virtually
async def test_after_a_quick_disk_nothing_is_read_twice() -> None:
    slow, quick = await rig_online(takes_s=0.9), await rig_online()

    for rig in (slow, quick):
        rig.submit("start", "1")
    await asyncio.sleep(5.0)

    def reads_before_write(rig: JournalRig) -> int:
        return next(number for number, sent in enumerate(rig.line.sent) if sent.request.is_write)

    assert reads_before_write(quick) < reads_before_write(slow)


@virtually
async def test_a_final_result_is_published_only_when_it_is_stored() -> None:
    rig = await rig_online(takes_s=0.2)
    rig.submit("start", "1")
    await rig.until_written()

    while not [result for result in rig.sink.of(ResultRecord) if result.phase.is_final]:
        stored_before = rig.disk.stored["alice", "1"].result.phase
        await asyncio.sleep(TRANSACTION_S)

    assert rig.disk.stored["alice", "1"].result.phase is Phase.CONFIRMED
    assert stored_before is Phase.WRITTEN
    assert rig.clock.utc_s() - rig.sink.final("1").time_s >= 0.2 - 1e-6


@virtually
async def test_that_a_command_is_accepted_is_published_only_when_it_is_stored() -> None:
    rig = await rig_online(takes_s=0.2)

    rig.submit("start", "1")
    await asyncio.sleep(0.1)
    rig.crash()
    await asyncio.sleep(5.0)

    assert rig.sink.phases("1") == []  # so a repetition gets nothing that contradicts this
    assert rig.disk.remembered() == []
    assert rig.line.writes == []


@virtually
async def test_phases_are_published_in_their_order_however_slow_the_disk_is() -> None:
    rig = await rig_online(takes_s=0.5)

    rig.submit("start", "1")
    await asyncio.sleep(10.0)

    assert [phase for phase, _ in rig.sink.phases("1")] == ["accepted", "written", "confirmed"]


@virtually
async def test_a_gateway_without_a_journal_publishes_at_once() -> None:
    calls: list[str] = []
    result = ResultRecord("pump-1", "alice", "1", "start", Phase.CONFIRMED, "ok", "", 0.0)

    NoJournal().note(result)
    NoJournal().note(result, then=lambda: calls.append("then"))
    await NoJournal().intend(result)

    assert calls == ["then"]
