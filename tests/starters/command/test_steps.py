"""Which step of a command may follow which, and how each may end."""

from __future__ import annotations

import pytest

from gateway.contract import Phase
from gateway.starters.command.steps import ENDS, NEXT, CommandStep, Life


def test_what_no_table_lists_is_a_bug() -> None:
    life = Life()

    with pytest.raises(ValueError, match="cannot go"):
        life.advance(CommandStep.WRITING)
    with pytest.raises(ValueError, match="cannot end"):
        life.end(Phase.CONFIRMED)
    assert life.step is CommandStep.RECEIVED


def test_what_was_written_is_never_decided_again_nor_called_rejected() -> None:
    assert NEXT[CommandStep.VERIFYING] == {CommandStep.DONE}
    assert Phase.REJECTED not in ENDS[CommandStep.VERIFYING]
    assert [step for step in CommandStep if Phase.UNCONFIRMED in ENDS[step]] == [CommandStep.VERIFYING]


def test_every_step_but_the_last_can_end() -> None:
    assert [step for step in CommandStep if not ENDS[step]] == [CommandStep.DONE]
    assert all(CommandStep.DONE in NEXT[step] for step in CommandStep if step is not CommandStep.DONE)


def test_after_a_write_that_may_be_refused_the_next_one_is_the_first() -> None:
    assert CommandStep.WRITING in NEXT[CommandStep.WRITING]
