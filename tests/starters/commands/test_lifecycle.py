"""Which phase of a command may follow which."""

from __future__ import annotations

import itertools

import pytest

from gateway.contract import Phase
from gateway.starters.commands.lifecycle import NEXT, Lifecycle

ENDS_UNWRITTEN = {Phase.CONFIRMED, Phase.FAILED, Phase.REJECTED}
ENDS_WRITTEN = {Phase.CONFIRMED, Phase.FAILED, Phase.UNCONFIRMED}


def test_the_table_knows_no_other_way_from_a_command_to_its_one_end() -> None:
    finals = {phase for phase in Phase if phase.is_final}

    assert NEXT[None] >= {Phase.ACCEPTED, Phase.REJECTED}
    assert NEXT[Phase.ACCEPTED] == {Phase.WRITTEN} | ENDS_UNWRITTEN
    assert NEXT[Phase.WRITTEN] == ENDS_WRITTEN
    assert [each for each in finals if NEXT[each]] == []


def test_every_pair_that_the_table_does_not_list_raises() -> None:
    for before, after in itertools.product([None, *Phase], Phase):
        life = Lifecycle()
        life.phase = before
        if after in NEXT[before]:
            life.advance(after)
            assert life.phase is after
        else:
            with pytest.raises(ValueError, match="cannot go"):
                life.advance(after)
