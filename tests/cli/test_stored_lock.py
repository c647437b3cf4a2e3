"""A maintenance lock counts for the commands that go to the starter's port directly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gateway.cli.parameters.restore import lock_trouble
from gateway.errors import CommandError
from gateway.records import LockRecord
from gateway.sim.factory import make_unit
from gateway.starters.policy.motor_history import PRECAUTIONS_FILE, MotorHistory
from gateway.system.clock import read_clocks
from tests.cli.parameters_place import ParametersPlace


def stored(folder: Path, starter: str = "pump") -> Path:
    logbook = MotorHistory([starter])
    logbook.set_lock(starter, LockRecord("alice", 5.0, "belt is off", "Alice A."))
    (folder / PRECAUTIONS_FILE).write_text(
        json.dumps(logbook.to_document(now_s=0.0, reading=read_clocks())), "utf-8"
    )
    return folder


def test_where_nothing_is_stored_or_another_starter_is_locked_there_is_no_lock(tmp_path: Path) -> None:
    assert lock_trouble(tmp_path / "nowhere", "pump") is None
    assert lock_trouble(stored(tmp_path, "fan"), "pump") is None


def test_a_memory_of_locks_that_cannot_be_read_counts_as_a_lock(tmp_path: Path) -> None:
    (tmp_path / PRECAUTIONS_FILE).write_text("[", "utf-8")

    trouble = lock_trouble(tmp_path, "pump")

    assert trouble is not None
    assert trouble.code == "locked"
    assert "cannot be read" in trouble.text


@pytest.mark.parametrize("with_sources", [False, True])
@pytest.mark.usefixtures("one_loop")
def test_nothing_is_restored_to_a_locked_starter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], with_sources: bool
) -> None:
    place = ParametersPlace(make_unit("ssw07", 1))
    place.state_dir = stored(tmp_path)

    with pytest.raises(CommandError, match=r"alice \(Alice A\.\): belt is off") as refused:
        place.restore({"P314": 3, "P220": 2}, with_sources=with_sources)

    assert refused.value.code == "locked"
    assert place.written == []
    assert place.restore({"P314": 3, "P220": 2}, with_sources=with_sources, is_dry=True) == 0
    assert "would be refused: locked for maintenance" in capsys.readouterr().out
