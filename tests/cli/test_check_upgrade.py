"""`check --upgrade` by a user who may not see all that it has to look at; what it says else are scenarios."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.cli.main import main
from gateway.starters.known_watchdogs import KNOWN_ROWS, WATCHDOGS, KnownRows
from gateway.store import STATE_FILE, write_document
from tests.config.sites import SITE

KNOWN = {"pump-1": KnownRows({"P314": (5,), "P313": (1,)})}  # s, action


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "state").mkdir()
    write_document(tmp_path / "state" / STATE_FILE, WATCHDOGS, KNOWN_ROWS, KNOWN)
    path = tmp_path / "site.toml"
    path.write_text(SITE.replace('name = "mcc1"', 'name = "mcc1"\nstate_dir = "state"'))
    return path


def test_where_this_user_may_not_look_nothing_is_accepted(
    config: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(path: Path) -> list[str]:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "listdir", refuse)

    assert main(["check", str(config), "--upgrade"]) == 1

    done = capsys.readouterr()
    assert "this user may not look into it (run this as the gateway's user, or as root)" in done.err
    assert done.out == ""


def test_a_lock_that_this_user_may_not_see_counts_as_that_of_a_gateway_that_runs(
    config: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lock, opened = config.parent / "state" / "gateway.lock", os.open

    def refuse(path: Path, *rest: int) -> int:
        if path == lock:
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *rest)

    monkeypatch.setattr(os, "open", refuse)

    assert main(["check", str(config), "--upgrade"]) == 75
    assert "no gateway runs" not in capsys.readouterr().out
