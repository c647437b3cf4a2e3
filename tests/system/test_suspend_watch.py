"""What stood still must not take what waited meanwhile for new."""

from __future__ import annotations

import pytest

from gateway.system.stalls import LOOK_EVERY_S, SUSPEND_LIMIT_S, SuspendWatch


class Clocks:
    """Two clocks that go as they are set."""

    def __init__(self) -> None:
        self.up_s, self.utc_s = 1000.0, 1.8e9
        self.reported_s: list[float] = []
        self.watch = SuspendWatch(lambda: self.up_s, up_s=lambda: self.up_s, utc_s=lambda: self.utc_s)
        self.watch.on_suspended = self.reported_s.append
        self.watch.look()

    def pass_by(self, up_s: float, utc_s: float) -> list[float]:
        """Let time pass, look once, and return what was reported."""
        self.up_s += up_s
        self.utc_s += utc_s
        self.watch.look()
        return self.reported_s


@pytest.mark.parametrize(
    ("up_s", "utc_s", "reported_s"),
    [
        (LOOK_EVERY_S, LOOK_EVERY_S, []),
        (SUSPEND_LIMIT_S, SUSPEND_LIMIT_S, []),
        (SUSPEND_LIMIT_S + 1, SUSPEND_LIMIT_S + 1, [SUSPEND_LIMIT_S + 1]),  # stopped, or slept
        (0.25, 3600.0, [3600.0]),  # paused with all its clocks, then set right
        (0.25, -3600.0, []),  # set back
        (5.0, -3600.0, [5.0]),
    ],
)
def test_a_gap_on_either_clock_is_a_suspension(up_s: float, utc_s: float, reported_s: list[float]) -> None:
    assert Clocks().pass_by(up_s, utc_s) == pytest.approx(reported_s)
