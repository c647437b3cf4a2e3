"""What a maintenance lock forbids, and how it is reasoned."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError, LockRecord
from gateway.starters.policy.preconditions import is_forbidden, reason_in, refusal


@pytest.mark.parametrize(
    "verb",
    ["start", "jog", "direction", "set", "configure", "general_enable", "output", "local_remote", "new"],
)
def test_a_lock_forbids_all_that_changes_something(verb: str) -> None:
    assert is_forbidden(verb, {"value": True})


@pytest.mark.parametrize(
    ("verb", "args"),
    [
        ("stop", {}),
        ("read", {}),
        ("reset", {}),
        ("jog", {"value": False}),
        ("general_enable", {"value": "false"}),
    ],
)
def test_a_lock_never_stands_in_the_way_of_stopping_or_reading(verb: str, args: dict[str, Any]) -> None:
    assert not is_forbidden(verb, args)


def test_a_refusal_says_who_locked_and_why_and_that_it_is_no_physical_lock() -> None:
    claimed = refusal(LockRecord(by="alice", since_s=0.0, reason="belt is off", operator="Alice A."))
    plain = refusal(LockRecord(by="alice", since_s=0.0, reason="belt is off"))

    assert claimed.code == "locked"
    assert claimed.text == (
        "locked for maintenance by alice (Alice A.): belt is off; this replaces no physical lock"
    )
    assert plain.text.startswith("locked for maintenance by alice: ")


def test_the_reason_comes_from_the_arguments_or_else_from_the_command() -> None:
    assert reason_in({"reason": " belt "}, "other") == "belt"
    assert reason_in({}, "other") == "other"


@pytest.mark.parametrize(
    ("args", "reason"),
    [
        ({}, None),
        ({}, "  "),
        ({"reason": 7}, "other"),
        ({"reason": "x" * 257}, None),
        ({"reason": "a\nb"}, None),
    ],
)
def test_a_lock_without_a_good_reason_is_refused(args: dict[str, Any], reason: str | None) -> None:
    with pytest.raises(CommandError) as caught:
        reason_in(args, reason)

    assert caught.value.code == "bad_arguments"
