"""Random histories of commands in virtual time, more of them than `make test` has, with other chance."""

from __future__ import annotations

from hypothesis import HealthCheck, seed, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.starters.command_machine import CommandMachine

STEPS = 30  # of a history


def histories(count: int, chance: int) -> tuple[list[str], dict[str, int]]:
    """Try so many; return what failed, with its steps, and counts. The same seed tries the same."""
    machine = type("Histories", (CommandMachine,), {})
    seed(chance)(machine)
    how = settings(
        max_examples=count,
        stateful_step_count=STEPS,
        deadline=None,
        database=None,
        print_blob=True,
        suppress_health_check=list(HealthCheck),
    )
    try:
        run_state_machine_as_test(machine, settings=how)
    except AssertionError as error:
        steps = "\n".join(getattr(error, "__notes__", ()))
        return [f"{error or 'a history that must not be'}\n{steps}"], {}
    except ExceptionGroup as errors:
        return [f"{error}\n" + "\n".join(getattr(error, "__notes__", ())) for error in errors.exceptions], {}
    return [], {"steps of each": STEPS}
