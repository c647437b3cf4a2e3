"""A backup and a restore that meet a full disk, the end of their process, or a wrong name."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import signal
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.storage.database import Database, snapshot
from gateway.storage.ledger_table import LedgerTable
from gateway.storage.upkeep.archive import Archive
from tests.cli.backup_site import build_site, files_below, lock_of, names_in, running

MOST_POINTS = 300
OWN = '{"writes": {"pump": 9}}'  # of a state that is to be replaced


def octets_below(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in files_below(folder)}


@pytest.mark.parametrize("name", ["etc/site.toml", "etc/state/gateway.sqlite", "etc/state/wear.json", "link"])
def test_a_backup_never_takes_the_place_of_anything_but_a_backup(
    name: str, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "link").symlink_to(site)
    before = octets_below(tmp_path)

    assert main(["backup", str(site), str(tmp_path / name)]) == 2

    assert octets_below(tmp_path) == before
    assert (tmp_path / "link").is_symlink()
    assert "is there, and no backup" in capsys.readouterr().err


def test_a_backup_is_written_to_no_device_folder_or_name_that_is_none(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", tmp_path, Path(), tmp_path / "none" / "plant.tar.gz"):
        assert main(["backup", str(site), str(name)]) == 2

    assert capsys.readouterr().err.count("\n") == 4
    assert (tmp_path / "pipe").is_fifo()


def test_what_a_killed_backup_has_left_goes_with_the_next_one(site: Path, tmp_path: Path) -> None:
    if (child := os.fork()) == 0:
        Archive.__init__ = lambda *_: os.kill(os.getpid(), signal.SIGKILL)  # type: ignore[assignment,method-assign]
        main(["backup", str(site), str(tmp_path / "plant.tar.gz"), "--secrets"])
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status)
    left = {path for path in tmp_path.iterdir() if path.name.startswith((".plant", "plant"))}
    assert left
    assert {path.stat().st_mode & 0o077 for path in left} == {0}

    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 0

    assert sorted(path.name for path in tmp_path.iterdir()) == ["etc", "plant.tar.gz", "ssl"]


def test_two_backups_to_one_file_do_not_meet(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copies = tmp_path / ".plant.tar.gz.copies"
    copies.mkdir(mode=0o700)
    (copies / "of-the-other").touch()
    descriptor = os.open(copies, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 1
    os.close(descriptor)
    copies.chmod(0o755)
    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 1

    err = capsys.readouterr().err
    assert "another process is writing a backup to" in err
    assert ".plant.tar.gz.copies is another user's" in err
    assert (copies / "of-the-other").exists()


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


def test_a_file_that_two_keys_name_in_two_ways_is_in_a_backup_once_and_comes_back(
    site: Path, tmp_path: Path
) -> None:
    authority = str(tmp_path / "ssl" / "ca.pem")
    (site.parent / "ca.pem").write_text("authority")
    text = site.read_text().replace(authority, "ca.pem")
    sparkplug = f'\n[sparkplug]\ngroup = "g"\nurls = ["mqtts://other"]\nca_file = "{site.parent}/ca.pem"\n'
    site.write_text(text.replace("[web]", f"{sparkplug}\n[web]", 1))

    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 0
    assert main(["restore", str(tmp_path / "plant.tar.gz"), "--to", str(tmp_path / "new")]) == 0

    assert names_in(tmp_path / "plant.tar.gz").count("config/ca.pem") == 1
    assert (tmp_path / "new" / "ca.pem").read_text() == "authority"


def test_a_configuration_that_is_named_by_a_way_upwards_has_its_files_beside_it(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(site.parent / "secret")

    assert main(["backup", "../site.toml", str(tmp_path / "plant.tar.gz"), "--secrets"]) == 0

    assert "config/secret/mqtt.password" in names_in(tmp_path / "plant.tar.gz")


def test_a_restore_elsewhere_says_which_names_in_the_configuration_are_of_before(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (site.parent / "ca.pem").write_text("authority")
    site.write_text(site.read_text().replace(str(tmp_path / "ssl"), str(site.parent)))
    main(["backup", str(site), str(tmp_path / "plant.tar.gz")])

    main(["restore", str(tmp_path / "plant.tar.gz"), "--to", str(tmp_path / "new")])

    now = f"names {site.parent}/ca.pem, which is {tmp_path}/new/ca.pem now: change it"
    assert now in capsys.readouterr().out


def test_a_restore_for_which_there_is_no_room_changes_nothing(
    backup: Path,
    site: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (site.parent / "state" / "gateway.lock").touch()
    (site.parent / "state" / "wear.json").write_text(OWN)
    before, left = octets_below(tmp_path), [3]
    extract = Archive.extract

    def full(self: Archive, name: str, path: Path) -> None:
        left[0] -= 1
        if not left[0]:
            path.write_bytes(b"half of")
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        extract(self, name, path)

    monkeypatch.setattr(Archive, "extract", full)
    for after in (1, 3, 11, 12):  # within the state, and within the configuration
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

    os.replace = before(os.replace)
    Path.replace = before(Path.replace)  # type: ignore[method-assign]
    Path.hardlink_to = before(Path.hardlink_to)  # type: ignore[method-assign]
    Path.rename = before(Path.rename)  # type: ignore[method-assign]
    shutil.rmtree = before(shutil.rmtree)  # type: ignore[assignment]


def test_a_restore_that_is_killed_at_any_point_leaves_all_of_before_or_no_configuration_and_can_go_on(
    backup: Path, tmp_path: Path
) -> None:
    kills, without = 0, 0
    for point in range(0, MOST_POINTS, 3):
        site = build_site(tmp_path / str(point))
        state, text = site.parent / "state", site.read_text()
        (state / "wear.json").write_text(OWN)
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

        assert json.loads((state / "wear.json").read_text())["writes"] == {"pump": 1}
        assert lock_of(state, "pump") is not None
        aside = state / "before-restore"
        assert is_complete or (aside / "wear.json").read_text() == OWN
        assert is_complete or site.with_name("site.toml.before-restore").read_text() == text
        assert (aside / "audit" / "audit-00000001.jsonl").exists()
        left = {name for name in files_below(site.parent) if name.endswith((".restored", ".new"))}
        assert left == set()
        assert not any((state / name).exists() for name in ("restoring", "restoring.new"))
    assert kills > without > 3


def test_what_is_in_the_way_of_a_state_is_set_aside_whatever_it_is(backup: Path, site: Path) -> None:
    state = site.parent / "state"
    (state / "wear.json").unlink()
    (state / "wear.json").mkdir()
    shutil.rmtree(state / "audit")
    (state / "audit").write_text("no folder")
    (state / "faults.json").unlink()
    (state / "faults.json").symlink_to("nowhere")

    assert main(["restore", str(backup), "--replace"]) == 0

    assert json.loads((state / "wear.json").read_text())["writes"] == {"pump": 1}
    assert (state / "audit" / "audit-00000001.jsonl").exists()
    assert (state / "before-restore" / "wear.json").is_dir()
    assert not (state / "faults.json").is_symlink()


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


def test_files_of_a_shared_folder_stay_their_owners(
    backup: Path, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[str] = []
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(os, "chown", lambda path, *_, **__: given.append(Path(path).name))
    (site.parent / "state" / "others.txt").write_text("not the gateway's")

    assert main(["restore", str(backup), "--replace"]) == 0

    assert "wear.json" in given
    assert "others.txt" not in given


def test_a_database_of_a_disk_that_cannot_be_written_is_copied_all_the_same(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, opened = site.parent / "state", []
    connect = sqlite3.connect

    def noted(name: Any, **options: Any) -> sqlite3.Connection:
        opened.append(str(name))
        return connect(name, **options)

    monkeypatch.setattr(sqlite3, "connect", noted)
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != state)

    snapshot(state / "gateway.sqlite", tmp_path / "copy")

    assert [name for name in opened if "immutable=1" in name]
    assert sorted(path.name for path in state.iterdir() if "-" in path.name) == ["home-assistant.json"]


def test_a_ledger_that_has_become_empty_counts_as_lost(tmp_path: Path) -> None:
    path = tmp_path / "gateway.sqlite"
    path.touch()
    database = Database(path, [LedgerTable()], 2**26)

    assert database.open() == ""

    database.close()
    assert database.lost_s is not None
