from __future__ import annotations

import itertools

import pytest

from gateway.errors import DamagedError
from gateway.plugins.homeassistant.announcements import BORN, LONGEST_PAUSE_S, Announcements, BirthPause


def test_what_was_announced_and_is_not_wanted_is_to_be_deleted() -> None:
    before = Announcements(None)
    assert before.add(["a", "b"])

    after = Announcements(before.document())

    assert after.unwanted(["b", "c"]) == ["a"]
    after.forget("a")
    assert after.unwanted(["b", "c"]) == []


@pytest.mark.parametrize("document", [{}, {"topics": "a"}, {"topics": [1]}])
def test_a_file_that_says_something_else_is_damaged(document: dict[str, object]) -> None:
    with pytest.raises(DamagedError):
        Announcements(document)


def test_the_answers_of_many_gateways_are_spread_over_five_seconds() -> None:
    pauses = []
    for seed in range(100):
        birth = BirthPause(seed)
        birth.take(BORN, 100.0)
        left_s = birth.left_s(100.0)
        assert left_s is not None
        pauses.append(left_s)

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
