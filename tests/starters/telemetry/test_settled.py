"""What two readings in a row say has happened."""

from __future__ import annotations

import pytest

from gateway.starters.telemetry.transitions import Settled, Watch


def settled(*states: str) -> str | None:
    """Return the settled state after these readings."""
    points = Settled()
    for at_s, state in enumerate(states):
        points.note({"state": (state, float(at_s))})
    return points.values.get("state")


@pytest.mark.parametrize(
    ("states", "state"),
    [
        (("ready", "ready"), "ready"),
        (("ready", "ready", "running"), "ready"),
        (("ready", "ready", "running", "ready", "running"), "ready"),
        (("ready", "ready", "running", "running"), "running"),
        (("ready", "ready", "starting", "running", "stopping"), "running"),
        (("ready", "ready", "starting", "fault", "starting"), "ready"),
    ],
)
def test_a_state_counts_after_two_readings_in_a_row_that_agree_on_whether_the_motor_was_started(
    states: tuple[str, ...], state: str
) -> None:
    assert settled(*states) == state


def test_a_reading_that_is_counted_twice_does_not_agree_with_itself() -> None:
    points = Settled()
    for _ in range(3):
        points.note({"state": ("running", 1.0)})

    assert "state" not in points.values


@pytest.mark.parametrize(
    ("first", "codes"), [("ready", ["started"]), ("not_ready", ["started"]), ("running", []), ("fault", [])]
)
def test_a_motor_that_was_at_rest_at_the_first_reading_and_runs_when_its_state_settles_was_started(
    first: str, codes: list[str]
) -> None:
    watch = Watch()
    watch.begin(first)
    watch.begin("starting")

    assert [change.code for change in watch.note("starting", remote=True, time_s=0.0)] == codes
