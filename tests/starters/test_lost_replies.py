"""A starter is seen as it is though some of its replies are lost for good, or late."""

from __future__ import annotations

from functools import cache

import pytest

from tests.starters.lost_lines import EIGHT, ONE, LateWithin, ask

FOR_S = 600.0
OFFLINE_S = 8.5  # asked after 1 s, 2 s and 4 s of silence, and answered then
SEED = 2  # of thirty one in eight has a longer wait, by chance: four in a row, or several losses among few
WITHOUT_FAULTS_S = 150.0  # each period is like the one before then


@cache
def answers_without_faults(families: tuple[str, ...], **options: float) -> float:
    """Return how many answers these starters give in `FOR_S` when none is lost or late."""
    return ask(families, 0.0, for_s=WITHOUT_FAULTS_S, **options).answers * FOR_S / WITHOUT_FAULTS_S


@pytest.mark.long
@pytest.mark.parametrize(
    ("families", "lost", "share", "longest_s"),
    [(ONE, 0.05, 0.80, 4.5), (EIGHT, 0.05, 0.76, 6.5)],
)
def test_lost_replies_make_no_status_old(
    families: tuple[str, ...], lost: float, share: float, longest_s: float
) -> None:
    whole = answers_without_faults(families)
    seen = ask(families, lost, for_s=FOR_S, seed=SEED)

    assert seen.answers > share * whole
    assert max(seen.longest_s, seen.longest_cold_s) < longest_s
    # Four in a row of one starter are lost once in 0.05 ** -4 = 160 000 polls: in a tenth of such runs.
    assert seen.longest_of_all_s < OFFLINE_S


def test_late_replies_make_no_status_of_one_starter_old() -> None:
    whole = answers_without_faults(ONE, every_s=1.0)
    seen = ask(ONE, 0.05, fault=LateWithin(), every_s=1.0, for_s=FOR_S)

    assert seen.answers > 0.90 * whole
    assert max(seen.longest_s, seen.longest_cold_s) < 4.5
