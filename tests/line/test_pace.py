"""A reply that began before its bytes can have come is doubted, where bytes do take their time."""

from __future__ import annotations

from gateway.line.rtu.reply_times import DOUBTS_ENOUGH, TIMELY_ENOUGH, Pace


def ask(pace: Pace, early_s: float) -> bool:
    pace.note_asked(1)
    return pace.is_too_soon(1, early_s=early_s, reply_s=0.015)


def test_doubts_go_on_while_true_answers_confirm_them_and_end_for_good_without() -> None:
    pace = Pace()
    assert not any(ask(pace, -0.005) for _ in range(TIMELY_ENOUGH))

    for _ in range(10 * DOUBTS_ENOUGH):
        assert ask(pace, 0.004)
        pace.note_stray(1)
    doubted = []
    for _ in range(20):
        doubted.append(ask(pace, 0.004))
        pace.note_stray(2)  # another unit's

    assert doubted == [True] * DOUBTS_ENOUGH + [False] * (20 - DOUBTS_ENOUGH)
