from __future__ import annotations

from gateway.line.rtu.reply_times import DOUBTS_ENOUGH, TIMELY_ENOUGH, Pace

REPLY_S = 0.015
IN_TIME_S, TOO_SOON_S = -0.005, 0.004


def paced() -> Pace:
    pace = Pace()
    for _ in range(TIMELY_ENOUGH):
        assert not ask(pace, IN_TIME_S)
    return pace


def ask(pace: Pace, early_s: float, unit: int = 1, reply_s: float = REPLY_S) -> bool:
    pace.note_asked(unit)
    return pace.is_too_soon(unit, early_s=early_s, reply_s=reply_s)


def test_on_a_line_where_bytes_take_their_time_a_reply_that_began_too_soon_is_doubted() -> None:
    pace = paced()

    assert ask(pace, TOO_SOON_S)
    assert not ask(pace, IN_TIME_S)


def test_a_starter_whose_bits_are_a_little_shorter_is_not_doubted() -> None:
    assert not ask(paced(), 0.0094, reply_s=0.3)
    assert ask(paced(), 0.0094, reply_s=0.03)


def test_where_bytes_never_take_their_time_nothing_is_doubted() -> None:
    pace = Pace()

    assert not any(ask(pace, TOO_SOON_S) for _ in range(100))


def test_a_line_is_trusted_only_after_some_replies_in_a_row_that_took_their_time() -> None:
    pace = Pace()
    for _ in range(TIMELY_ENOUGH - 1):
        ask(pace, IN_TIME_S)

    assert not ask(pace, TOO_SOON_S)
    assert not ask(pace, TOO_SOON_S)


def test_doubts_that_nothing_confirms_end_for_good() -> None:
    pace = paced()

    doubted = [ask(pace, TOO_SOON_S) for _ in range(20)]
    for _ in range(10):
        ask(pace, IN_TIME_S)

    assert doubted == [True] * DOUBTS_ENOUGH + [False] * (20 - DOUBTS_ENOUGH)
    assert not ask(pace, TOO_SOON_S)


def test_short_replies_that_took_their_time_prove_nothing_for_long_ones() -> None:
    pace = paced()
    doubted = []

    for _ in range(20):
        assert not ask(pace, IN_TIME_S, unit=1)
        doubted.append(ask(pace, TOO_SOON_S, reply_s=0.1))

    assert doubted.count(True) == DOUBTS_ENOUGH


def test_the_true_answer_that_follows_confirms_the_doubt() -> None:
    pace = paced()

    for _ in range(10 * DOUBTS_ENOUGH):
        assert ask(pace, TOO_SOON_S)
        pace.note_stray(2)
        pace.note_stray(1)


def test_a_reply_in_time_of_the_same_kind_shows_that_bytes_do_take_their_time() -> None:
    pace = paced()

    for _ in range(10 * DOUBTS_ENOUGH):
        assert ask(pace, TOO_SOON_S)
        assert not ask(pace, IN_TIME_S)
