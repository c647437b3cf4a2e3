"""What a sequence of states is as events."""

from __future__ import annotations

import pytest

from gateway.starters.telemetry.transitions import Watch


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
