"""A backup and a restore that meet a full disk, the end of their process, a wrong name or a forged file."""

from __future__ import annotations

import errno
import fcntl
import io
import json
import os
import shutil
import signal
import tarfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.starters.policy.write_budget import WRITES
from gateway.store import HISTORY_FILE, STATE_FILE, read_document, write_document
from gateway.store import backup as backups
from gateway.store.backup import Archive
from gateway.store.schema import SCHEMAS
from tests.cli.backup_site import BackupSite, lock_of

MOST_POINTS = 300
OWN = {"pump": 9}  # writes, of a state that is to be replaced
LOCK = "etc/state/gateway.lock"


@contextmanager
def running(state_dir: Path) -> Iterator[None]:
    """Hold the lock of a gateway that runs."""
    with (state_dir / "gateway.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def test_a_restore_for_which_there_is_no_room_changes_nothing(
    backup: Path, place: BackupSite, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place.folder / LOCK).touch()
    write_document(place.state / STATE_FILE, "writes", WRITES, OWN)
    before, left = place.files(), [0]
    extract = Archive.extract

    def full(self: Archive, name: str, path: Path) -> None:
        left[0] -= 1
        if not left[0]:
            path.write_bytes(b"half of")
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        extract(self, name, path)

    monkeypatch.setattr(Archive, "extract", full)
    for left[0] in (1, 2, 3, 4):  # within the state, and within the configuration
        place.cli(f"restore {backup} --replace", 1, err="No space left on device")
        assert place.files() | {LOCK: b""} == before


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
        place = BackupSite(tmp_path / str(point))
        site, state, text = place.config, place.state, place.config.read_text()
        write_document(state / STATE_FILE, "writes", WRITES, OWN)
        (place.folder / LOCK).touch()
        before = place.files()
        restore = f"restore {backup} --to {site.parent} --replace"
        if (child := os.fork()) == 0:
            die_at(point)
            os._exit(main(restore.split()))
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            break
        kills += 1
        if site.exists() and site.read_text() == text:
            now = place.files()
            assert {name: now[name] for name in before} == before | {LOCK: now[LOCK]}
        without += not site.exists()

        place.cli(restore)

        assert read_document(state / STATE_FILE, "writes", WRITES) == {"pump": 1}
        assert lock_of(state, "pump")
        asides = [path for path in state.glob("before-restore-*") if (path / STATE_FILE).exists()]
        assert OWN in [read_document(path / STATE_FILE, "writes", WRITES) for path in asides]
        assert text in [path.read_text() for path in site.parent.glob("site.toml.before-restore-*")]
        assert [name for name in place.files() if name.endswith((".restored", ".new"))] == []
        assert not (state / "restoring").exists()
    assert kills > without > 3


def test_a_gateway_that_runs_by_the_configuration_is_left_alone_with_another_state_dir_too(
    backup: Path, place: BackupSite
) -> None:
    var = place.folder / "var"
    place.state.rename(var)
    place.change('"state"', '"DIR/var"')

    with running(var):
        before = place.files()
        place.cli(f"restore {backup} --replace", 1, err="a gateway runs by")

    assert place.files() == before


def test_the_files_of_0_2_0_are_not_copied_while_it_runs(place: BackupSite) -> None:
    (place.state / STATE_FILE).unlink()

    with running(place.state):
        place.cli("backup SITE DIR/plant.tar.gz", 1, err="a gateway of 0.2.0 runs")

    assert not (place.folder / "plant.tar.gz").exists()


def test_a_damaged_file_and_what_a_killed_backup_has_left(place: BackupSite) -> None:
    for name in (".plant.tar.gz.x.copies", ".plant.tar.gz"):
        (place.folder / name).mkdir()
    (place.state / HISTORY_FILE).write_text("Dear diary, " * 1000)

    said = "history.sqlite: file is not a database (start the gateway once"
    place.cli("backup SITE DIR/plant.tar.gz", 1, err=said)

    assert {path.name for path in place.folder.iterdir()} == {"etc", "ssl", ".plant.tar.gz"}


def test_a_backup_never_takes_what_another_one_of_the_same_name_has_half_copied(
    place: BackupSite, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy_state = backups.copy_state

    def half(_: Path, to: Path) -> None:
        for name in SCHEMAS:
            (to / name).touch()
        os._exit(0)  # killed

    def beside_another(state_dir: Path, to: Path) -> dict[str, int]:
        versions = copy_state(state_dir, to)
        if (child := os.fork()) == 0:
            monkeypatch.setattr(backups, "copy_state", half)
            place.cli("backup SITE DIR/plant.tar.gz")
        os.waitpid(child, 0)
        return versions

    monkeypatch.setattr(backups, "copy_state", beside_another)
    place.cli("backup SITE DIR/plant.tar.gz", 1, err="No such file or directory")

    assert not (place.folder / "plant.tar.gz").exists()


Members = dict[str, tuple[tarfile.TarInfo, bytes]]  # of a backup, by their names


def altered(path: Path, change: Callable[[Members], object]) -> Path:
    """Return a copy of a backup whose members were changed."""
    to, members = path.with_name("altered.tar.gz"), Members()
    with tarfile.open(path) as source:
        for info in source.getmembers():
            file = source.extractfile(info)
            assert file is not None
            members[info.name] = info, file.read()
    change(members)
    with tarfile.open(to, "w:gz") as target:
        for info, content in members.values():
            info.size = len(content) if info.isreg() else 0
            target.addfile(info, io.BytesIO(content))
    return to


def having(name: str, content: bytes | None = None, **facts: object) -> Callable[[Members], None]:
    """Return the change of a member's content, and of what the tar says of it."""

    def change(members: Members) -> None:
        info, before = members[name]
        for fact, value in facts.items():
            setattr(info, fact, value)
        members[name] = info, before if content is None else content

    return change


def saying(**facts: object) -> Callable[[Members], None]:
    """Return the change of the manifest."""

    def change(members: Members) -> None:
        info, text = members["manifest.json"]
        members["manifest.json"] = info, json.dumps({**json.loads(text), **facts}).encode()

    return change


def named(old: str, new: str) -> Callable[[Members], None]:
    """Return the change of a member's name, also in the manifest."""

    def change(members: Members) -> None:
        members[old][0].name = new
        info, text = members["manifest.json"]
        members["manifest.json"] = info, text.replace(json.dumps(old).encode(), json.dumps(new).encode())

    return change


STATE = "state/state.sqlite"
BAD = {
    "is a link": having(STATE, type=tarfile.SYMTYPE, linkname="/etc/passwd"),
    "is a hard link": having(STATE, type=tarfile.LNKTYPE, linkname="manifest.json"),
    "is a folder": having(STATE, type=tarfile.DIRTYPE),
    "is no file that the configuration names": named(STATE, "config/cron.d/evil"),
    "has a list for a text": saying(version=["0.2.0"]),
    "has no whole folder": saying(folder="etc"),
    "climbs out of the configuration's folder": named("config/site.toml", "config/../../evil"),
    "has a whole path": named(STATE, "/tmp/evil"),
    "is no file of a state": named(STATE, "state/gateway.lock"),
    "was changed": having(STATE, b"another"),
    "is missing": lambda members: members.pop(STATE),
    "has no manifest": lambda members: members.pop("manifest.json"),
    "has a damaged manifest": having("manifest.json", b"{}"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_backup_that_was_tampered_with_writes_nothing(what: str, backup: Path, place: BackupSite) -> None:
    bad = altered(backup, BAD[what])
    before = place.files()

    ran = place.cli(f"restore {bad} --to DIR/new", 1, err="starter-gateway: ")

    assert ran.err.count("\n") == 1
    assert place.files() == before


@pytest.mark.parametrize("facts", [{"format": 2}, {"state": {STATE_FILE: 1, HISTORY_FILE: 2}}], ids=str)
def test_a_backup_of_a_later_version_is_refused_with_78(
    facts: dict[str, Any], backup: Path, place: BackupSite
) -> None:
    bad = altered(backup, saying(**facts))

    place.cli(f"restore {bad} --to DIR/new", 78, err="was made by a later version")

    assert not (place.folder / "new").exists()
