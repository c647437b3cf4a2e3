"""How often and how soon the gateway lets a motor be started."""

from __future__ import annotations

import pytest

from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.start_rules import Rulebook, RuleSet, is_release, is_start

HOUR_S = 3600.0


def book(**rules: RuleSet) -> tuple[Rulebook, MotorHistory]:
    named = {name.replace("_", "-"): each for name, each in rules.items()}
    motor_history = MotorHistory([*named, "other"])
    return Rulebook(named, motor_history), motor_history


def test_nothing_is_demanded_where_nothing_is_configured() -> None:
    rulebook, motor_history = book()
    for _ in range(100):
        motor_history.note_start("other", now_s=0.0)

    assert rulebook.check_start("other", now_s=0.0) is None
    assert not rulebook.of("other").is_counting


@pytest.mark.parametrize(
    ("rules", "is_counting"),
    [
        (RuleSet(two_step=frozenset({"start"})), False),
        (RuleSet(starts_per_hour=3), True),
        (RuleSet(minimum_pause_s=1.0), True),
        (RuleSet(feeder="a", stagger_s=1.0), True),
    ],
)
def test_only_rules_that_look_back_need_a_memory(rules: RuleSet, is_counting: bool) -> None:
    assert rules.is_counting is is_counting


def test_so_many_starts_an_hour_and_then_one_for_each_that_is_an_hour_old() -> None:
    rulebook, motor_history = book(a=RuleSet(starts_per_hour=2))
    motor_history.note_start("a", now_s=100.0)
    assert rulebook.check_start("a", now_s=200.0) is None
    motor_history.note_start("a", now_s=200.0)

    violation = rulebook.check_start("a", now_s=300.0)

    assert violation is not None
    assert violation.code == "too_many_starts"
    assert "2 times in the last hour, 2 are allowed" in violation.text
    assert violation.text.endswith("wait 3400 s")
    assert rulebook.check_start("a", now_s=100.0 + HOUR_S) is None


def test_more_starts_than_allowed_take_longer_to_be_forgotten() -> None:
    rulebook, motor_history = book(a=RuleSet(starts_per_hour=1))
    motor_history.note_start("a", now_s=0.0)
    motor_history.note_start("a", now_s=600.0)  # a local one, say

    violation = rulebook.check_start("a", now_s=1000.0)

    assert violation is not None
    assert violation.text.endswith("wait 3200 s")


def test_a_motor_must_have_stood_still_for_its_pause() -> None:
    rulebook, motor_history = book(a=RuleSet(minimum_pause_s=60.0))
    motor_history.note_state("a", "running", now_s=0.0)
    motor_history.note_state("a", "stopping", now_s=10.0)
    motor_history.note_state("a", "ready", now_s=20.0)

    violation = rulebook.check_start("a", now_s=50.0)

    assert violation is not None
    assert violation.code == "pause_too_short"
    assert "30 s of 60 s" in violation.text
    assert rulebook.check_start("a", now_s=80.0) is None


def test_the_pause_of_a_motor_that_was_never_seen_to_stand_has_not_begun() -> None:
    rulebook, _ = book(a=RuleSet(minimum_pause_s=60.0))

    violation = rulebook.check_start("a", now_s=1e6)

    assert violation is not None
    assert "not been seen at standstill" in violation.text


def test_starters_of_a_feeder_start_one_after_the_other() -> None:
    on_a = RuleSet(feeder="a", stagger_s=5.0)
    rulebook, motor_history = book(p1=on_a, p2=on_a, p3=RuleSet(feeder="b", stagger_s=5.0))
    motor_history.note_start("p1", now_s=10.0)

    violation = rulebook.check_start("p2", now_s=12.0)

    assert violation is not None
    assert violation.code == "feeder_busy"
    assert "p1 started 2.0 s ago on feeder a" in violation.text
    assert rulebook.check_start("p3", now_s=12.0) is None
    assert rulebook.check_start("p1", now_s=12.0) is None  # its own start is the other rules' business
    assert rulebook.check_start("p2", now_s=15.0) is None


def test_a_feeder_without_a_time_or_a_time_without_a_feeder_demands_nothing() -> None:
    rulebook, motor_history = book(
        p1=RuleSet(feeder="a"), p2=RuleSet(feeder="a"), p3=RuleSet(stagger_s=5.0), p4=RuleSet(stagger_s=5.0)
    )
    motor_history.note_start("p1", now_s=10.0)
    motor_history.note_start("p3", now_s=10.0)

    assert rulebook.check_start("p2", now_s=10.0) is None
    assert rulebook.check_start("p4", now_s=10.0) is None


@pytest.mark.parametrize(
    ("verb", "args", "starts", "releases"),
    [
        ("start", {}, True, False),
        ("jog", {"value": True}, True, False),
        ("jog", {}, True, False),
        ("jog", {"value": "off"}, False, True),
        ("general_enable", {"value": True}, False, False),
        ("general_enable", {"value": False}, False, True),
        ("set", {"value": False}, False, False),
    ],
)
def test_a_jog_is_a_start_and_taking_it_back_is_not(
    verb: str, args: dict[str, object], starts: bool, releases: bool
) -> None:
    assert is_start(verb, args) is starts
    assert is_release(verb, args) is releases
