"""What two readings in a row say has happened, and what a sequence of states is as events."""

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


@pytest.mark.parametrize(
    ("states", "codes"),
    [
        ("running", []),  # what is there at the first look did not happen
        ("ready", []),
        ("unknown", []),
        ("ready starting running stopping ready", ["started", "stopped"]),
        ("running stopping starting", ["started"]),
        ("ready running fault ready", ["started", "fault"]),
        ("ready not_ready ready", []),
        ("ready unknown running", ["started"]),
    ],
)
def test_states_are_events(states: str, codes: list[str]) -> None:
    watch = Watch()

    changes = [watch.note(state, remote=True, time_s=at_s) for at_s, state in enumerate(states.split())]

    assert [change.code for each in changes for change in each] == codes


@pytest.mark.parametrize(("first", "run_s"), [("ready", 15.5), ("running", None)])
def test_a_stop_says_how_long_the_motor_was_on_where_its_start_was_seen(first: str, run_s: float) -> None:
    watch = Watch()
    watch.note(first, remote=None, time_s=0.0)
    watch.note("running", remote=None, time_s=10.0)

    (stopped,) = watch.note("ready", remote=None, time_s=25.5)

    assert stopped.data.get("run_s") == run_s


def test_a_switch_to_local_and_back_are_events() -> None:
    watch = Watch()
    flags = [True, None, False, False, True]

    changes = [change.code for remote in flags for change in watch.note("ready", remote=remote, time_s=0.0)]

    assert changes == ["local_operation", "remote_operation"]
