"""How long a restart leaves a starter without a request, for the worst case, and how that is announced."""

from __future__ import annotations

import pytest

from gateway.app.capacity import prospects_of
from gateway.app.restart import STOP_S, RestartGap, announcement, restart_gaps
from gateway.line.capacity.outage import START_UP_S
from tests.config.sites import site

PROSPECTS = prospects_of(site())
LIMITS: dict[str, float | None] = {"pump-1": 5.0, "pump-2": None}


def test_the_gap_is_that_of_the_polls_and_the_end_and_the_start_of_the_process() -> None:
    gaps = {gap.starter: gap for gap in restart_gaps(PROSPECTS, limit_of=LIMITS.get)}

    (line,) = PROSPECTS
    for starter in line.starters:
        gap = gaps[starter.table.name]
        assert gap.gap_s == pytest.approx(starter.gap_s + STOP_S + START_UP_S + starter.first_poll_s)
        assert gap.limit_s == LIMITS[gap.starter]


@pytest.mark.parametrize(
    ("limit_s", "is_safe"), [(None, True), (2.9, False), (3.0, True), (0.5, False), (60.0, True)]
)
def test_a_watchdog_must_be_half_as_long_again_as_the_gap(limit_s: float | None, is_safe: bool) -> None:
    assert RestartGap("a", 2.0, limit_s).is_safe is is_safe


def test_the_announcement_names_the_longest_gap_and_the_watchdogs_that_may_act() -> None:
    text, data = announcement("ended by SIGTERM", PROSPECTS, limit_of=LIMITS.get)
    calm, quiet = announcement("x", PROSPECTS, limit_of=lambda _: None)

    assert text.startswith(
        "the gateway ends: ended by SIGTERM; if it is started again at once, nothing is polled"
    )
    assert text.endswith("longer than the watchdog of pump-1 allows")
    assert data["too_short"] == ["pump-1"]
    assert data["starter"] in LIMITS
    assert "watchdog" not in calm
    assert quiet["too_short"] == []
