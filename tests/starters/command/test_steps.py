"""Which step of a command may follow which, and how each may end."""

from __future__ import annotations

import itertools

import pytest

from gateway.contract import Phase
from gateway.starters.command.steps import ENDS, NEXT, Life, Step

FINALS = [phase for phase in Phase if phase.is_final]


def at(step: Step) -> Life:
    life = Life()
    life.step = step
    return life


@pytest.mark.parametrize(("before", "after"), [*itertools.product(Step, Step)])
def test_a_step_follows_another_only_where_the_table_lists_it(before: Step, after: Step) -> None:
    life = at(before)
    if after in NEXT[before]:
        life.advance(after)
        assert life.step is after
    else:
        with pytest.raises(ValueError, match="cannot go"):
            life.advance(after)


@pytest.mark.parametrize(("step", "phase"), [*itertools.product(Step, FINALS)])
def test_a_command_ends_only_as_the_table_lists_it(step: Step, phase: Phase) -> None:
    life = at(step)
    if phase in ENDS[step]:
        life.end(phase)
        assert life.step is Step.DONE
    else:
        with pytest.raises(ValueError, match="cannot"):
            life.end(phase)


def test_what_was_written_is_never_decided_again_nor_called_rejected() -> None:
    assert NEXT[Step.VERIFYING] == {Step.DONE}
    assert Phase.REJECTED not in ENDS[Step.VERIFYING]
    assert [step for step in Step if Phase.UNCONFIRMED in ENDS[step]] == [Step.VERIFYING]


def test_every_step_but_the_last_can_end() -> None:
    assert [step for step in Step if not ENDS[step]] == [Step.DONE]
    assert all(Step.DONE in NEXT[step] for step in Step if step is not Step.DONE)
