"""The SSW-06's way out of its adjusting modes (S6-10, S6-11)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import prepare
from gateway.families.profile.load import load_profile
from tests.families.starters import READY, SLOT_1, built, words


@pytest.mark.parametrize(("mode", "word"), [("factory", 1), ("P202", 2), ("p202", 2)])
def test_a_mode_is_left_by_its_bit_of_vb07_and_the_device_restarts(mode: str, word: int) -> None:
    procedure = built("ssw06", "configure", {"leave": mode}, VB06=word, VB01=READY, VB03=0)

    assert words(procedure) == [(5007, word)]
    assert procedure.steps[-1].is_silence_expected
    assert procedure.verify is not None
    assert procedure.verify.within_s > load_profile("ssw06").timing.restart_s
    assert procedure.verify.is_met({"VB06": (0,), "running": False})
    assert procedure.verify.is_met({"VB06": (3 - word,), "running": False})
    assert not procedure.verify.is_met({"VB06": (word,), "running": False})
    assert not procedure.verify.is_met({"VB06": (0,), "running": True})


@pytest.mark.parametrize(("mode", "shown"), [("factory", 2), ("P202", 1), ("P202", 0)])
def test_a_mode_that_vb06_does_not_show_is_not_left(mode: str, shown: int) -> None:
    with pytest.raises(CommandError, match="not_in_that_mode"):
        built("ssw06", "configure", {"leave": mode}, VB06=shown)


def test_the_motor_must_rest_and_the_mode_be_read() -> None:
    preparation = prepare(load_profile("ssw06"), SLOT_1, "configure", {"leave": "P202"})

    assert preparation.requires == ("is_stopped",)
    assert {code for read in preparation.reads for code in read.codes} == {"VB01", "VB06"}


@pytest.mark.parametrize("args", [{}, {"leave": "both"}, {"leave": 1}, {"leave": "P202", "R41": 1}])
def test_anything_else_is_refused(args: dict[str, Any]) -> None:
    with pytest.raises(CommandError, match="bad_arguments"):
        prepare(load_profile("ssw06"), SLOT_1, "configure", args)
