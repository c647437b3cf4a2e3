from __future__ import annotations

import pytest

from gateway.starters.telemetry.transitions import Watch


def codes(*states: str) -> list[str]:
    watch = Watch()
    return [
        change.code
        for second, state in enumerate(states)
        for change in watch.note(state, remote=True, time_s=float(second))
    ]


@pytest.mark.parametrize("state", ["running", "ready", "unknown"])
def test_what_is_there_at_the_first_look_did_not_happen(state: str) -> None:
    assert codes(state) == []


def test_a_start_and_a_stop_are_one_event_each() -> None:
    assert codes("ready", "starting", "running", "stopping", "ready") == ["started", "stopped"]


def test_a_start_while_the_motor_decelerates_is_a_start() -> None:
    assert codes("running", "stopping", "starting") == ["started"]


def test_a_fault_ends_the_run_without_a_stop() -> None:
    assert codes("ready", "running", "fault", "ready") == ["started", "fault"]


def test_a_motor_that_is_ready_and_then_not_is_no_event() -> None:
    assert codes("ready", "not_ready", "ready") == []


def test_a_start_during_silence_is_an_event_when_the_starter_answers_again() -> None:
    assert codes("ready", "unknown", "running") == ["started"]


def test_a_stop_says_how_long_the_motor_was_on() -> None:
    watch = Watch()
    watch.note("ready", remote=None, time_s=0.0)
    watch.note("running", remote=None, time_s=10.0)

    (stopped,) = watch.note("ready", remote=None, time_s=25.5)

    assert stopped.data == {"from": "running", "to": "ready", "run_s": 15.5}


def test_a_stop_whose_start_was_not_seen_has_no_duration() -> None:
    watch = Watch()
    watch.note("running", remote=None, time_s=0.0)

    (stopped,) = watch.note("ready", remote=None, time_s=1.0)

    assert "run_s" not in stopped.data


def test_a_switch_to_local_and_back_are_events() -> None:
    watch = Watch()
    flags = [True, None, False, False, True]

    changes = [change.code for remote in flags for change in watch.note("ready", remote=remote, time_s=0.0)]

    assert changes == ["local_operation", "remote_operation"]
