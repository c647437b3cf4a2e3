"""What is remembered of starts, standstills and locks, and what a restart or a clock's step makes of it."""

from __future__ import annotations

import pytest

from gateway.contract import LockRecord
from gateway.starters.policy.motor_history import MOST_STARTS, MOTORS, MotorHistory
from gateway.system.clock import ClockReading

UTC_S = 1_760_000_000.0
SAVED = ClockReading(5000.0, UTC_S, "boot-1")
DAY_S = 86400.0


def seen(*states: tuple[float, str]) -> MotorHistory:
    motor_history = MotorHistory()
    for now_s, state in states:
        motor_history.note_state("a", state, now_s=now_s)
    return motor_history


def restored(
    motor_history: MotorHistory, *, saved_s: float, now_s: float, reading: ClockReading
) -> MotorHistory:
    """Return the motor history of the next run, whose steady clock shows `now_s` at that reading."""
    body = MOTORS.dump_json(motor_history.stored(now_s=saved_s, reading=SAVED))
    new = MotorHistory()
    new.restore(MOTORS.validate_json(body), now_s=now_s, reading=reading)
    return new


def later(seconds: float, *, step_s: float = 0.0) -> ClockReading:
    """Return the machine's clocks so long after `SAVED`, the wall's set ahead by a step."""
    return ClockReading(SAVED.up_s + seconds, SAVED.utc_s + seconds + step_s, SAVED.boot_id)


@pytest.mark.parametrize(
    ("states", "starts", "standing_since"),
    [
        ("5 ready, 9 not_ready, 10 fault", [], 5.0),
        ("5 ready, 9 starting, 10 running, 11 stopping", [9.0], None),  # a start at the keypad counts
        ("5 running", [], None),  # it was not started then
        ("5 ready, 9 -, 9.5 starting", [9.0], None),  # our own start counts once
        ("5 ready, 9 -, 60 starting", [9.0, 60.0], None),  # somebody else's, so long after ours
        ("5 ready, 7 unknown, 8 ready", [], 5.0),
    ],
)
def test_what_is_seen_of_a_motor_and_our_own_starts_are_its_history(
    states: str, starts: list[float], standing_since: float | None
) -> None:
    motor_history = MotorHistory()
    for at_s, state in map(str.split, states.split(",")):
        if state == "-":
            motor_history.note_start("a", now_s=float(at_s))
        else:
            motor_history.note_state("a", state, now_s=float(at_s))

    assert motor_history.starts_since("a", 0.0) == starts
    assert motor_history.standing_since("a") == standing_since


def test_starts_older_than_an_hour_are_forgotten_and_never_more_than_a_thousand_stored() -> None:
    motor_history = MotorHistory()
    motor_history.note_start("a", now_s=0.0)
    for second in range(MOST_STARTS + 10):
        motor_history.note_start("a", now_s=3601.0 + second)

    starts = motor_history.starts_since("a", -1.0)

    assert len(starts) == MOST_STARTS
    assert starts[0] == 3611.0


LOCK = LockRecord(by="alice", since_s=UTC_S, reason="belt", operator="Alice A.")


@pytest.mark.parametrize(
    ("reading", "passed_s"),
    [
        *((later(30.0, step_s=step_s), 30.0) for step_s in (0.0, -DAY_S, -20.0, 20.0, DAY_S)),
        # Of a restart of the machine only the time since its boot has certainly passed.
        (ClockReading(40.0, UTC_S + DAY_S, "boot-2"), 40.0),
        (ClockReading(40.0, UTC_S + DAY_S, "boot-1"), 40.0),  # the same: as where it cannot be read
    ],
)
def test_a_restart_forgets_nothing_and_no_step_of_the_clock_changes_an_age(
    reading: ClockReading, passed_s: float
) -> None:
    motor_history = seen((100.0, "ready"))
    motor_history.note_start("a", now_s=150.0)
    motor_history.set_lock("a", LOCK)

    new = restored(motor_history, saved_s=200.0, now_s=7.0, reading=reading)

    assert new.standing_since("a") == pytest.approx(7.0 - passed_s - 100.0)
    assert new.starts_since("a", 7.0 - 3600.0) == [pytest.approx(7.0 - passed_s - 50.0)]
    assert new.lock_of("a") == LOCK


def test_a_motor_that_moved_before_the_restart_stands_since_it_is_seen_to() -> None:
    new = restored(seen((1.0, "running")), saved_s=2.0, now_s=7.0, reading=later(600.0))
    assert new.standing_since("a") is None

    new.note_state("a", "ready", now_s=9.0)

    assert new.standing_since("a") == 9.0
