"""What is remembered of starts, standstills and locks, and what a restart or a clock's step makes of it."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import DamagedError
from gateway.starters.logbook import MOST_STARTS, Logbook
from gateway.starters.records import LockRecord

UTC_S = 1_760_000_000.0


def seen(*states: tuple[float, str]) -> Logbook:
    logbook = Logbook(["a"])
    for now_s, state in states:
        logbook.note_state("a", state, now_s=now_s)
    return logbook


def restored(logbook: Logbook, *, saved_s: float, now_s: float, utc_s: float) -> Logbook:
    """Return the logbook of the next run, whose steady clock shows `now_s` at `utc_s`."""
    document = logbook.to_document(lambda at_s: UTC_S + at_s - saved_s)
    new = Logbook(["a"])
    new.restore(document, now_s=now_s, utc_s=utc_s)
    return new


def test_a_standstill_counts_from_when_it_was_first_seen() -> None:
    logbook = seen((5.0, "ready"), (9.0, "not_ready"), (10.0, "fault"))

    assert logbook.standing_since("a") == 5.0


def test_a_moving_motor_does_not_stand() -> None:
    logbook = seen((5.0, "ready"), (9.0, "starting"), (10.0, "running"), (11.0, "stopping"))

    assert logbook.standing_since("a") is None


def test_a_local_start_counts_as_a_start() -> None:
    logbook = seen((5.0, "ready"), (9.0, "starting"), (10.0, "running"))

    assert logbook.starts_since("a", 0.0) == [9.0]


def test_a_motor_that_runs_when_it_is_first_seen_was_not_started_then() -> None:
    assert seen((5.0, "running")).starts_since("a", 0.0) == []


def test_our_own_start_counts_once() -> None:
    logbook = seen((5.0, "ready"))
    logbook.note_start("a", now_s=9.0)
    logbook.note_state("a", "starting", now_s=9.5)

    assert logbook.starts_since("a", 0.0) == [9.0]


def test_a_motor_that_moves_long_after_our_start_was_started_by_another() -> None:
    logbook = seen((5.0, "ready"))
    logbook.note_start("a", now_s=9.0)
    logbook.note_state("a", "starting", now_s=60.0)

    assert logbook.starts_since("a", 0.0) == [9.0, 60.0]


def test_a_state_that_is_not_known_changes_nothing() -> None:
    logbook = seen((5.0, "ready"))

    assert not logbook.note_state("a", "unknown", now_s=7.0)
    assert not logbook.note_state("a", "ready", now_s=8.0)
    assert logbook.standing_since("a") == 5.0


def test_a_starter_that_is_not_configured_has_no_page() -> None:
    assert not Logbook(["a"]).note_state("b", "ready", now_s=7.0)


def test_starts_older_than_an_hour_are_forgotten_and_never_more_than_a_thousand_kept() -> None:
    logbook = Logbook(["a"])
    logbook.note_start("a", now_s=0.0)
    for second in range(MOST_STARTS + 10):
        logbook.note_start("a", now_s=3601.0 + second)

    starts = logbook.starts_since("a", -1.0)

    assert len(starts) == MOST_STARTS
    assert starts[0] == 3611.0


def test_a_restart_forgets_nothing() -> None:
    logbook = seen((100.0, "ready"))
    logbook.note_start("a", now_s=150.0)
    logbook.set_lock("a", LockRecord("alice", UTC_S, "belt", "Alice A."))

    new = restored(logbook, saved_s=200.0, now_s=7.0, utc_s=UTC_S + 30.0)

    assert new.standing_since("a") == pytest.approx(7.0 - 130.0)
    assert new.starts_since("a", -1e9) == [pytest.approx(7.0 - 80.0)]
    assert new.lock_of("a") == LockRecord("alice", UTC_S, "belt", "Alice A.")


def test_a_motor_that_moved_before_the_restart_stands_since_it_is_seen_to() -> None:
    new = restored(seen((1.0, "running")), saved_s=2.0, now_s=7.0, utc_s=UTC_S + 600.0)
    assert new.standing_since("a") is None

    new.note_state("a", "ready", now_s=9.0)

    assert new.standing_since("a") == 9.0


def test_a_clock_that_was_set_back_lets_nothing_seem_older_than_it_is() -> None:
    new = restored(seen((100.0, "ready")), saved_s=200.0, now_s=7.0, utc_s=UTC_S - 86400.0)

    assert new.standing_since("a") == 7.0


def test_what_was_kept_of_a_starter_that_is_configured_no_more_is_dropped() -> None:
    new = Logbook(["b"])

    new.restore(seen((1.0, "ready")).to_document(lambda at_s: UTC_S), now_s=0.0, utc_s=UTC_S)

    assert new.standing_since("b") is None


PAGE: dict[str, Any] = {"starts": [], "moving": None, "standing_since": None, "lock": None}


@pytest.mark.parametrize(
    "document",
    [
        {},
        {"version": 2, "starters": {}},
        {"version": 1, "starters": []},
        {"version": 1, "starters": {"a": {}}},
        {"version": 1, "starters": {"a": {**PAGE, "starts": ["x"]}}},
        {"version": 1, "starters": {"a": {**PAGE, "starts": [float("nan")]}}},
        {"version": 1, "starters": {"a": {**PAGE, "lock": {"by": "x"}}}},
        {"version": 1, "starters": {"a": {**PAGE, "more": 1}}},
    ],
)
def test_what_is_not_what_was_kept_is_damaged(document: dict[str, Any]) -> None:
    with pytest.raises(DamagedError):
        Logbook(["a"]).restore(document, now_s=0.0, utc_s=UTC_S)
