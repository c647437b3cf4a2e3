"""A starter is seen as it is though some of its replies are lost for good, or late."""

from __future__ import annotations

import pytest

from tests.starters.lost_lines import EIGHT, ONE, LateWithin, ask

FOR_S = 600.0


@pytest.mark.parametrize(
    ("families", "lost", "share", "longest_s"),
    [(ONE, 0.01, 0.93, 2.7), (ONE, 0.05, 0.80, 4.5), (EIGHT, 0.05, 0.78, 6.5)],
)
def test_lost_replies_make_no_status_old(
    families: tuple[str, ...], lost: float, share: float, longest_s: float
) -> None:
    whole = ask(families, 0.0, for_s=FOR_S)
    seen = ask(families, lost, for_s=FOR_S)

    assert seen.answers > share * whole.answers
    assert max(seen.longest_s, seen.longest_cold_s) < longest_s


@pytest.mark.parametrize(("every_s", "share", "longest_s"), [(1.0, 0.90, 4.5), (0.25, 0.50, 5.5)])
def test_late_replies_make_no_status_of_one_starter_old(
    every_s: float, share: float, longest_s: float
) -> None:
    whole = ask(ONE, 0.0, every_s=every_s, for_s=FOR_S)
    seen = ask(ONE, 0.05, fault=LateWithin(), every_s=every_s, for_s=FOR_S)

    assert seen.answers > share * whole.answers
    assert max(seen.longest_s, seen.longest_cold_s) < longest_s
