"""What a maintenance lock forbids, and how it is reasoned."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.starters.policy.preconditions import is_forbidden, reason_in


@pytest.mark.parametrize("verb", ["start", "direction", "configure", "output", "local_remote", "new"])
def test_a_lock_forbids_all_that_changes_something(verb: str) -> None:
    assert is_forbidden(verb, {"value": True})


@pytest.mark.parametrize("reason", ["  ", 7, "x" * 257, "a\nb"])
def test_a_lock_without_a_good_reason_is_refused(reason: Any) -> None:
    with pytest.raises(CommandError, match="bad_arguments"):
        reason_in({"reason": reason}, "other")
