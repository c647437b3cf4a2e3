"""How long a restart leaves a starter without a request, for the worst case, and how that is announced."""

from __future__ import annotations

import pytest

from gateway.app.capacity import prospects_of
from gateway.app.restart import RestartGap, announcement
from tests.config.sites import site

PROSPECTS = prospects_of(site())
LIMITS: dict[str, float | None] = {"pump-1": 5.0, "pump-2": None}


@pytest.mark.parametrize(
    ("limit_s", "is_safe"), [(None, True), (2.9, False), (3.0, True), (0.5, False), (60.0, True)]
)
def test_a_watchdog_must_be_half_as_long_again_as_the_gap(limit_s: float | None, is_safe: bool) -> None:
    assert RestartGap("a", 2.0, limit_s).is_safe is is_safe


def test_the_announcement_names_the_longest_gap_and_the_watchdogs_that_may_act() -> None:
    loud = announcement("ended by SIGTERM", PROSPECTS, limit_of=LIMITS.get)
    calm = announcement("x", PROSPECTS, limit_of=lambda _: None)

    assert loud.text.startswith(
        "the gateway ends: ended by SIGTERM; if it is started again at once, nothing is polled"
    )
    assert loud.text.endswith("longer than the watchdog of pump-1 permits")
    assert loud.data["too_short"] == ["pump-1"]
    assert loud.data["starter"] in LIMITS
    assert "watchdog" not in calm.text
    assert calm.data["too_short"] == []
