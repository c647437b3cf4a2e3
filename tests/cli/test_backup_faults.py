"""A backup and a restore that meet a full disk, the end of their process, or a wrong name."""

from __future__ import annotations

import errno
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.starters.policy.write_budget import WRITES
from gateway.store import HISTORY_FILE, STATE_FILE, read_document, write_document
from gateway.store.backup import Archive
from tests.cli.backup_site import build_site, files_below, lock_of, names_in, running

MOST_POINTS = 300
OWN = {"pump": 9}  # writes, of a state that is to be replaced


def octets_below(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in files_below(folder)}


def test_a_key_is_a_secret_whatever_names_it(site: Path, tmp_path: Path) -> None:
    (site.parent / "both.pem").write_text(
        "-----BEGIN CERTIFICATE-----\n-----BEGIN EC PRIVATE KEY-----\nhunter3\n"
    )
    both = 'cert_file = "both.pem"\nkey_file = "both.pem"\n'
    site.write_text(site.read_text().replace("[web]", f"{both}\n[web]"))
    authority = str(tmp_path / "ssl" / "ca.pem")
    site.write_text(site.read_text().replace(authority, "secret/../both.pem"))

    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 0
    assert main(["backup", str(site), str(tmp_path / "full.tar.gz"), "--secrets"]) == 0

    assert "config/both.pem" not in names_in(tmp_path / "plant.tar.gz")
    assert "config/both.pem" in names_in(tmp_path / "full.tar.gz")
    site.write_text(site.read_text().replace(both, ""))
    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 0
    assert "config/both.pem" not in names_in(tmp_path / "plant.tar.gz")


def test_a_restore_for_which_there_is_no_room_changes_nothing(
    backup: Path,
    site: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (site.parent / "state" / "gateway.lock").touch()
    write_document(site.parent / "state" / STATE_FILE, "writes", WRITES, OWN)
    before, left = octets_below(tmp_path), [3]
    extract = Archive.extract

    def full(self: Archive, name: str, path: Path) -> None:
        left[0] -= 1
        if not left[0]:
            path.write_bytes(b"half of")
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        extract(self, name, path)

    monkeypatch.setattr(Archive, "extract", full)
    for after in (1, 2, 3, 4):  # within the state, and within the configuration
        left[0] = after
        assert main(["restore", str(backup), "--replace"]) == 1
        found = octets_below(tmp_path)
        found["etc/state/gateway.lock"] = b""
        assert found == before
        assert "No space left on device" in capsys.readouterr().err


def die_at(point: int) -> None:
    """End the process before its n-th change of a name, of those that a restore makes."""
    left = [point]

    def before(call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: Any, **options: Any) -> Any:
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1
            return call(*args, **options)

        return counted

    calls = ((os, "replace link"), (Path, "replace unlink rename"), (shutil, "rmtree"))
    for owner, name in ((owner, name) for owner, names in calls for name in names.split()):
        setattr(owner, name, before(getattr(owner, name)))


def test_a_restore_that_is_killed_at_any_point_leaves_all_of_before_or_no_configuration_and_can_go_on(
    backup: Path, tmp_path: Path
) -> None:
    kills, without = 0, 0
    for point in range(0, MOST_POINTS, 3):
        site = build_site(tmp_path / str(point))
        state, text = site.parent / "state", site.read_text()
        write_document(state / STATE_FILE, "writes", WRITES, OWN)
        (state / "gateway.lock").touch()
        before = octets_below(site.parent)
        if (child := os.fork()) == 0:
            die_at(point)
            os._exit(main(["restore", str(backup), "--to", str(site.parent), "--replace"]))
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            break
        kills += 1
        is_complete = site.exists() and site.read_text() != text
        if site.exists() and not is_complete:
            now = octets_below(site.parent)
            assert {name: now[name] for name in before} == before | {
                "state/gateway.lock": now["state/gateway.lock"]
            }
        without += not site.exists()

        assert main(["restore", str(backup), "--to", str(site.parent), "--replace"]) == 0

        assert read_document(state / STATE_FILE, "writes", WRITES) == {"pump": 1}
        assert lock_of(state, "pump") is not None
        asides = [path for path in state.glob("before-restore-*") if (path / STATE_FILE).exists()]
        texts = [path.read_text() for path in site.parent.glob("site.toml.before-restore-*")]
        assert OWN in [read_document(path / STATE_FILE, "writes", WRITES) for path in asides]
        assert text in texts
        left = {name for name in files_below(site.parent) if name.endswith((".restored", ".new"))}
        assert left == set()
        assert not (state / "restoring").exists()
    assert kills > without > 3


def test_a_gateway_that_runs_by_the_configuration_is_left_alone_with_another_state_dir_too(
    backup: Path, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (site.parent / "state").rename(tmp_path / "var")
    site.write_text(site.read_text().replace('"state"', f'"{tmp_path / "var"}"'))
    before = octets_below(site.parent)

    with running(tmp_path / "var"):
        assert main(["restore", str(backup), "--replace"]) == 1

    assert "a gateway runs by" in capsys.readouterr().err
    assert octets_below(site.parent) == before


def test_the_files_of_0_2_0_are_not_copied_while_it_runs(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (site.parent / "state" / STATE_FILE).unlink()

    with running(site.parent / "state"):
        assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 1

    assert "a gateway of 0.2.0 runs" in capsys.readouterr().err
    assert not (tmp_path / "plant.tar.gz").exists()


def test_a_damaged_file_and_what_a_killed_backup_has_left(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    left, other = tmp_path / ".plant.tar.gz.x.copies", tmp_path / ".plant.tar.gz"
    for folder in (left, other):
        folder.mkdir()
    (site.parent / "state" / HISTORY_FILE).write_text("Dear diary, " * 1000)

    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 1

    assert "history.sqlite: file is not a database (start the gateway once" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"etc", "ssl", other.name}
