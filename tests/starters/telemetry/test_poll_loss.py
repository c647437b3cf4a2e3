from __future__ import annotations

import random

from gateway.line.rtu.outcome import Silent
from gateway.records import AvailabilityRecord
from gateway.starters.telemetry.polling import OF, POOR, PollLoss
from tests.starters.rig import Rig, virtually


def test_a_few_lost_polls_are_no_news() -> None:
    loss = PollLoss()

    assert [loss.note(is_lost=count % 40 == 0) for count in range(10 * OF)] == [None] * (10 * OF)


def test_a_poor_line_is_said_once_and_that_it_is_good_again_once() -> None:
    loss = PollLoss()
    said = [loss.note(is_lost=True) for _ in range(POOR)] + [loss.note(is_lost=False) for _ in range(2 * OF)]

    assert [each for each in said if each is not None] == ["8 of its last 8 polls had no right reply", ""]


@virtually
async def test_a_starter_whose_replies_are_lost_now_and_then_is_degraded_and_stays_online() -> None:
    rig, dice = await Rig().online(), random.Random(1)
    rig.line.rules.append(lambda _: Silent() if dice.random() < 0.1 else None)

    await rig.poll_for(200.0)

    said = rig.sink.of(AvailabilityRecord)
    assert {each.state for each in said} == {"degraded"}
    assert "had no right reply" in (said[0].reason or "")
