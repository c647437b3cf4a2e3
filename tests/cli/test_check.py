"""`check` by a user who may not see all that it has to look at, and of adapters; the rest are scenarios."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.starters.known_watchdogs import KNOWN_ROWS, WATCHDOGS, KnownRows
from gateway.store import STATE_FILE, write_document
from tests.config.sites import SITE, changed
from tests.rig import run_cli
from tests.rig.sites import line, starter


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    site = SITE.replace('name = "mcc1"', 'name = "mcc1"\nstate_dir = "state"')
    (tmp_path / "site.toml").write_text(site, "utf-8")
    (tmp_path / "state").mkdir()
    return tmp_path


def test_what_this_machine_has_otherwise_is_warned_of(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.cli.check.stable_name", lambda port: f"/dev/serial/by-id/usb-{port[-1]}")
    monkeypatch.setattr("gateway.cli.check.os.access", lambda path, _: path.name != "plant-ca.pem")
    (folder / "plant-ca.pem").touch()
    (folder / "link").symlink_to("/dev/ttyUSB0")
    second = line("b", port=str(folder / "link")) + starter("mixer", 1, "sst")
    text = changed(("/dev/rs485-pumps", "/dev/ttyUSB0"), ("[mqtt]", '[mqtt]\nca_file = "plant-ca.pem"'))
    (folder / "site.toml").write_text(text.replace("[[operator]]", second + "[[operator]]"), "utf-8")

    ran = run_cli("check", str(folder / "site.toml"))

    assert ran.code == 0
    for said in (
        "warning line pumps: /dev/ttyUSB0 may be another adapter tomorrow (use /dev/serial/by-id/usb-0)",
        "warning line b: its port is that of line pumps (put all starters of a port under one [[line]])",
        "plant-ca.pem may not be read (let this user read it)",
    ):
        assert said in ran.out


def test_where_this_user_may_not_look_nothing_is_accepted(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path) -> list[str]:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "listdir", refuse)

    ran = run_cli("check", str(folder / "site.toml"), "--upgrade")

    assert (ran.code, ran.out) == (1, "")
    assert "this user may not look into it (run this as the gateway's user, or as root)" in ran.err


def test_a_lock_that_this_user_may_not_see_counts_as_that_of_a_gateway_that_runs(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = {"pump-1": KnownRows({"P314": (5,), "P313": (1,)})}  # s, action
    write_document(folder / "state" / STATE_FILE, WATCHDOGS, KNOWN_ROWS, known)
    opened = os.open

    def refuse(path: Path, *rest: int) -> int:
        if path == folder / "state" / "gateway.lock":
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *rest)

    monkeypatch.setattr(os, "open", refuse)

    ran = run_cli("check", str(folder / "site.toml"), "--upgrade")

    assert (ran.code, "no gateway runs" in ran.out) == (75, False)
