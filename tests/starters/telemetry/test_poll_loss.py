from __future__ import annotations

from gateway.starters.telemetry.polling import OF, POOR, PollLoss


def test_a_few_lost_polls_are_no_news() -> None:
    loss = PollLoss()

    assert [loss.note(is_lost=count % 40 == 0) for count in range(10 * OF)] == [None] * (10 * OF)


def test_a_poor_line_is_said_once_and_that_it_is_good_again_once() -> None:
    loss = PollLoss()
    said = [loss.note(is_lost=True) for _ in range(POOR)] + [loss.note(is_lost=False) for _ in range(2 * OF)]

    assert [each for each in said if each is not None] == ["8 of its last 8 polls had no valid reply", ""]
