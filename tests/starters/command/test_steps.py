"""Which step of a command may follow which, and how each may end."""

from __future__ import annotations

import itertools

import pytest

from gateway.contract import Phase
from gateway.starters.command.steps import ENDS, NEXT, CommandStep, Life

FINALS = [phase for phase in Phase if phase.is_final]


def at(step: CommandStep) -> Life:
    life = Life()
    life.step = step
    return life


@pytest.mark.parametrize(("before", "after"), [*itertools.product(CommandStep, CommandStep)])
def test_a_step_follows_another_only_where_the_table_lists_it(
    before: CommandStep, after: CommandStep
) -> None:
    life = at(before)
    if after in NEXT[before]:
        life.advance(after)
        assert life.step is after
    else:
        with pytest.raises(ValueError, match="cannot go"):
            life.advance(after)


@pytest.mark.parametrize(("step", "phase"), [*itertools.product(CommandStep, FINALS)])
def test_a_command_ends_only_as_the_table_lists_it(step: CommandStep, phase: Phase) -> None:
    life = at(step)
    if phase in ENDS[step]:
        life.end(phase)
        assert life.step is CommandStep.DONE
    else:
        with pytest.raises(ValueError, match="cannot"):
            life.end(phase)


def test_what_was_written_is_never_decided_again_nor_called_rejected() -> None:
    assert NEXT[CommandStep.VERIFYING] == {CommandStep.DONE}
    assert Phase.REJECTED not in ENDS[CommandStep.VERIFYING]
    assert [step for step in CommandStep if Phase.UNCONFIRMED in ENDS[step]] == [CommandStep.VERIFYING]


def test_every_step_but_the_last_can_end() -> None:
    assert [step for step in CommandStep if not ENDS[step]] == [CommandStep.DONE]
    assert all(CommandStep.DONE in NEXT[step] for step in CommandStep if step is not CommandStep.DONE)


def test_after_a_write_that_may_be_refused_the_next_one_is_the_first() -> None:
    life = at(CommandStep.WRITING)

    life.advance(CommandStep.WRITING)

    assert not life.is_written
