"""Which step of a command may follow which, and how each may end."""

from __future__ import annotations

from typing import Any, cast

import pytest

from gateway.contract import CommandRequest, Phase
from gateway.starters.command.report import NEXT, CommandReport, CommandStep


def test_what_the_table_does_not_list_is_a_bug() -> None:
    report = CommandReport(CommandRequest("pump", "alice", "start", id="1"), cast("Any", None))

    for step in (CommandStep.WRITING, Phase.CONFIRMED):
        with pytest.raises(ValueError, match="cannot become"):
            report.advance(step)
    assert report.step is CommandStep.RECEIVED


def test_what_was_written_is_never_decided_again_nor_called_rejected() -> None:
    assert set(NEXT[CommandStep.VERIFYING]) == {Phase.CONFIRMED, Phase.FAILED, Phase.UNCONFIRMED}
    assert [step for step in CommandStep if Phase.UNCONFIRMED in NEXT[step]] == [CommandStep.VERIFYING]


def test_every_step_but_the_last_can_end() -> None:
    assert [step for step in CommandStep if not set(Phase) & set(NEXT[step])] == [CommandStep.DONE]
