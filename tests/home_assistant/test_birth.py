from __future__ import annotations

import itertools

from gateway.plugins.homeassistant.birth import BORN, LONGEST_PAUSE_S, BirthPause


def test_the_answers_of_many_gateways_are_spread_over_five_seconds() -> None:
    pauses = []
    for seed in range(100):
        birth = BirthPause(seed)
        birth.take(BORN, 100.0)
        pauses.append(birth.left_s(100.0))

    assert min(pauses) < 0.5
    assert LONGEST_PAUSE_S - 0.5 < max(pauses) <= LONGEST_PAUSE_S


def test_a_flood_of_births_is_answered_once_in_five_seconds() -> None:
    birth = BirthPause(1)
    answers_s = []
    for now_s in (0.01 * step for step in range(6_000)):
        birth.take(BORN, now_s)
        if birth.left_s(now_s) == 0.0:
            birth.answered(now_s)
            answers_s.append(now_s)

    gaps = [after - before for before, after in itertools.pairwise(answers_s)]
    assert 6 <= len(answers_s) <= 12
    assert min(gaps) >= LONGEST_PAUSE_S - 0.02
