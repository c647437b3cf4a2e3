"""On which readings an accepted command is judged."""

from __future__ import annotations

import asyncio

import pytest

from gateway.line.rtu.outcome import Garbled, Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.records import Phase
from tests.starters.fakes import FAULT, READY, VB01
from tests.starters.rig import virtually
from tests.starters.rules import (
    ACCEPTED,
    change_direction_bit,
    false_reading,
    ready,
)


@virtually
async def test_a_start_is_judged_on_readings_taken_after_it_arrived() -> None:
    rig = await ready()

    rig.submit("start")
    await asyncio.sleep(5.0)

    first = rig.line.sent[0]
    assert not first.request.is_write
    assert first.lane is Priority.COMMAND


@virtually
async def test_a_start_needs_two_readings_when_the_last_poll_is_old() -> None:
    rig = await ready(is_snapshot_old=True)

    rig.submit("start")
    await asyncio.sleep(5.0)

    kinds = [sent.request.is_write for sent in rig.line.sent]
    assert kinds.index(True) >= 2
    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_one_false_reading_does_not_let_a_start_pass() -> None:
    rig = await ready(is_snapshot_old=True)
    rig.unit.holding[VB01] = READY | FAULT
    rig.line.rules.append(false_reading(rig, READY))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.final().code == "fault_active"
    assert rig.line.writes == []


@virtually
async def test_a_poll_from_before_the_fault_went_away_costs_one_more_reading() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = READY | FAULT
    rig.poll()
    rig.unit.holding[VB01] = READY
    rig.line.sent.clear()

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert [sent.request.is_write for sent in rig.line.sent[:3]] == [False, False, True]
    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_a_command_word_that_never_reads_twice_the_same_is_not_built_upon() -> None:
    rig = await ready("ssw900", is_snapshot_old=True)
    rig.line.rules.append(lambda request: change_direction_bit(rig, request))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.final().code == "readings_disagree"
    assert rig.line.writes == []


@pytest.mark.parametrize(
    ("outcome", "code"),
    [
        (Silent(), "expired"),
        (Garbled("bad CRC", b"\x07"), "expired"),
        (Silent("port closed", is_sent=False), "line_down"),
    ],
)
@virtually
async def test_a_starter_whose_status_cannot_be_read_freshly_is_not_started(
    outcome: Outcome, code: str
) -> None:
    rig = await ready()
    rig.line.rules.append(lambda request: outcome)

    rig.submit("start", expires_s=rig.clock.now_s() + 4.0)
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("rejected", code)]
    assert rig.line.writes == []


@virtually
async def test_a_start_ends_at_once_when_the_starter_goes_offline_under_it() -> None:
    rig = await ready()
    rig.line.rules.append(lambda request: Silent())

    rig.submit("start", expires_s=rig.clock.now_s() + 4.0)
    await asyncio.sleep(0.2)
    rig.lose()
    await asyncio.sleep(0.8)

    assert rig.sink.phases() == [ACCEPTED, ("rejected", "no_answer")]
