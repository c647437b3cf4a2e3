"""`check` by a user who may not see all that it has to look at, and of adapters; the rest are scenarios."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.cli.main import main
from gateway.starters.known_watchdogs import KNOWN_ROWS, WATCHDOGS, KnownRows
from gateway.store import STATE_FILE, write_document
from tests.config.sites import SITE, changed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    site = SITE.replace('name = "mcc1"', 'name = "mcc1"\nstate_dir = "state"')
    (tmp_path / "site.toml").write_text(site, "utf-8")
    (tmp_path / "state").mkdir()
    return tmp_path


def test_a_name_that_is_not_stable_gets_the_advice_of_the_stable_one(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.cli.check.stable_name", lambda port: f"/dev/serial/by-id/usb-{port[-1]}")
    (folder / "site.toml").write_text(changed(("/dev/rs485-pumps", "/dev/ttyUSB0")), "utf-8")

    assert main(["check", str(folder / "site.toml")]) == 0

    assert "adapter tomorrow (use /dev/serial/by-id/usb-0)" in capsys.readouterr().out


def test_a_file_that_this_user_may_not_read_is_a_warning(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.cli.check.os.access", lambda path, _: path.name != "plant-ca.pem")
    (folder / "plant-ca.pem").write_text("", "utf-8")
    url = 'url = "mqtts://broker.plant:8883"'
    (folder / "site.toml").write_text(changed((url, f'{url}\nca_file = "plant-ca.pem"')), "utf-8")

    assert main(["check", str(folder / "site.toml")]) == 0

    assert "plant-ca.pem may not be read (let this user read it)" in capsys.readouterr().out


def test_where_this_user_may_not_look_nothing_is_accepted(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(path: Path) -> list[str]:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "listdir", refuse)

    assert main(["check", str(folder / "site.toml"), "--upgrade"]) == 1

    done = capsys.readouterr()
    assert "this user may not look into it (run this as the gateway's user, or as root)" in done.err
    assert done.out == ""


def test_a_lock_that_this_user_may_not_see_counts_as_that_of_a_gateway_that_runs(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    known = {"pump-1": KnownRows({"P314": (5,), "P313": (1,)})}  # s, action
    write_document(folder / "state" / STATE_FILE, WATCHDOGS, KNOWN_ROWS, known)
    lock, opened = folder / "state" / "gateway.lock", os.open

    def refuse(path: Path, *rest: int) -> int:
        if path == lock:
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *rest)

    monkeypatch.setattr(os, "open", refuse)

    assert main(["check", str(folder / "site.toml"), "--upgrade"]) == 75
    assert "no gateway runs" not in capsys.readouterr().out
