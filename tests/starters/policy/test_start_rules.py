"""How often and how soon the gateway lets a motor be started."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

from gateway.contract import CommandError
from gateway.starters.policy.motor_history import MotorHistory
from gateway.starters.policy.start_rules import (
    NO_RULES,
    PolicySettings,
    RuleSet,
    demand_start,
    is_release,
    is_start,
)

TWO_AN_HOUR = {"a": RuleSet(starts_per_hour=2)}
ONE_AN_HOUR = {"a": RuleSet(starts_per_hour=1)}
PAUSE = {"a": RuleSet(minimum_pause_s=60.0)}
ON_A = RuleSet(feeder="a", stagger_s=5.0)
FEEDERS = {"p1": ON_A, "p2": ON_A, "p3": RuleSet(feeder="b", stagger_s=5.0)}
NO_TIME = {"p1": RuleSet(feeder="a"), "p2": RuleSet(feeder="a")}
NO_FEEDER = {"p1": RuleSet(stagger_s=5.0), "p2": RuleSet(stagger_s=5.0)}
STOPPED = ("a running 0", "a stopping 10", "a ready 20")

ASKED = [  # rules, what happened when, who would start when, the refusal: its code and two parts of its text
    ({}, ("other start 0",) * 100, "other 0", None),
    (TWO_AN_HOUR, ("a start 100",), "a 200", None),
    (
        TWO_AN_HOUR,
        ("a start 100", "a start 200"),
        "a 300",
        ("too_many_starts", "2 times in the last hour, 2 are allowed", "wait 3400 s"),
    ),
    (TWO_AN_HOUR, ("a start 100", "a start 200"), "a 3700", None),
    # more starts than allowed, a local one perhaps, take longer to be forgotten
    (ONE_AN_HOUR, ("a start 0", "a start 600"), "a 1000", ("too_many_starts", "2 times", "wait 3200 s")),
    (PAUSE, STOPPED, "a 50", ("pause_too_short", "30 s of 60 s", "")),
    (PAUSE, STOPPED, "a 80", None),
    (PAUSE, (), "a 1000000", ("pause_too_short", "not been seen at standstill", "")),
    (FEEDERS, ("p1 start 10",), "p2 12", ("feeder_busy", "p1 started 2.0 s ago on feeder a", "")),
    (FEEDERS, ("p1 start 10",), "p3 12", None),
    (FEEDERS, ("p1 start 10",), "p1 12", None),  # its own start is the other rules' business
    (FEEDERS, ("p1 start 10",), "p2 15", None),
    (NO_TIME, ("p1 start 10",), "p2 10", None),
    (NO_FEEDER, ("p1 start 10",), "p2 10", None),
]


@pytest.mark.parametrize(("rules", "lived", "asked", "refused"), ASKED)
def test_a_start_is_refused_for_what_was_before(
    rules: dict[str, RuleSet], lived: tuple[str, ...], asked: str, refused: tuple[str, str, str] | None
) -> None:
    motor_history = MotorHistory()
    for name, what, at_s in map(str.split, lived):
        if what == "start":
            motor_history.note_start(name, now_s=float(at_s))
        else:
            motor_history.note_state(name, what, now_s=float(at_s))
    name, now_s = asked.split()

    code, within, end = refused or ("", "", "")
    with pytest.raises(CommandError, match=within) if refused else nullcontext() as caught:
        demand_start(PolicySettings(rules), motor_history, name, now_s=float(now_s))

    assert caught is None or (caught.value.code == code and caught.value.text.endswith(end))


def test_only_rules_that_look_back_need_a_memory() -> None:
    without = NO_RULES, RuleSet(two_step=frozenset({"start"}))
    counting = RuleSet(starts_per_hour=3), PAUSE["a"], ON_A

    assert [rules.is_counting for rules in (*without, *counting)] == [False, False, True, True, True]


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
