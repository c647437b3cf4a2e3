from __future__ import annotations

import itertools

import pytest

from gateway.records import Phase
from gateway.starters.commands.lifecycle import NEXT, Lifecycle


def lived(*phases: Phase) -> Lifecycle:
    life = Lifecycle()
    for phase in phases:
        life.advance(phase)
    return life


def test_a_start_goes_from_accepted_over_written_to_confirmed() -> None:
    life = lived(Phase.ACCEPTED, Phase.WRITTEN, Phase.CONFIRMED)

    assert life.phase is Phase.CONFIRMED
    assert not life.is_written


def test_a_new_command_is_not_written() -> None:
    life = Lifecycle()

    assert life.phase is None
    assert not life.is_written


def test_a_command_of_which_something_went_out_is_written() -> None:
    life = lived(Phase.ACCEPTED, Phase.WRITTEN)

    assert life.is_written


@pytest.mark.parametrize("final", [phase for phase in Phase if phase.is_final])
@pytest.mark.parametrize("later", Phase)
def test_nothing_follows_a_final_result(final: Phase, later: Phase) -> None:
    assert later not in NEXT[final]


def test_what_was_written_can_never_be_rejected() -> None:
    life = lived(Phase.ACCEPTED, Phase.WRITTEN)

    with pytest.raises(ValueError, match="from written to rejected"):
        life.advance(Phase.REJECTED)


def test_what_was_not_written_can_never_be_unconfirmed() -> None:
    with pytest.raises(ValueError, match="from accepted to unconfirmed"):
        lived(Phase.ACCEPTED, Phase.UNCONFIRMED)


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
