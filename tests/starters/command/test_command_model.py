"""Whatever happens, in whatever order: a start goes out once at most, lawfully; every command has one end."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from tests.starters.command_machine import CommandMachine

pytestmark = pytest.mark.long

# Several cases, so that several processes share the histories; each draws its own, by the name of its class.
for number in range(3):
    machine: Any = type(f"CommandMachine{number}", (CommandMachine,), {})
    machine.TestCase.settings = settings(
        max_examples=9,
        stateful_step_count=30,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    globals()[f"TestCommands{number}"] = machine.TestCase


def test_stops_beyond_those_that_are_followed_up_have_one_end_too() -> None:
    machine = CommandMachine()
    try:
        for number in range(30):
            machine.stop("both" if number % 5 == 4 else "a", ("alice", "bob", "mallory")[number % 3])
    finally:
        machine.teardown()
