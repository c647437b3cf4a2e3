"""A site that is backed up, and what a test looks at in a backup and in what comes back."""

from __future__ import annotations

import fcntl
import io
import json
import shutil
import sqlite3
import tarfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from gateway.contract import LockRecord
from gateway.plugins.sparkplug.numbers import BIRTHS, NUMBER
from gateway.starters.policy.motor_history import LOCKS, MOTORS, MotorHistory
from gateway.starters.policy.write_budget import WRITES
from gateway.store import STATE_FILE, append_note, read_document, write_document
from gateway.system.clock_steps import ClockReading
from gateway.system.password_hash import password_line
from tests.rig.sites import line, operator, starter, table
from tests.storage.golden.state import unpack_golden

UTC_S = 1_760_000_000.0
HASH = password_line("correct horse")
CONFIG = (
    table("gateway", name="plant", state_dir="state")
    + table(
        "mqtt",
        url="mqtts://broker.plant",
        username="plant",
        password_file="secret/mqtt.password",
        ca_file="OUTSIDE/ca.pem",
    )
    + "[web]\n"
    + table("[web.user]", name="ann", operator="alice", password=HASH)
    + line("hall")
    + starter("pump", 1, "ssw07")
    + starter("mill", 3, "ssw900")
    + operator("alice")
)


def names_in(path: Path) -> list[str]:
    with tarfile.open(path) as archive:
        return archive.getnames()


def manifest_of(path: Path) -> dict[str, Any]:
    with tarfile.open(path) as archive:
        source = archive.extractfile("manifest.json")
        assert source is not None
        found: dict[str, Any] = json.load(source)
        return found


def files_below(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def altered(path: Path, change: Callable[[str, bytes], tuple[tarfile.TarInfo, bytes] | None]) -> Path:
    """Return a copy of a backup in which each member became another one, or none."""
    to = path.with_name("altered.tar.gz")
    with tarfile.open(path) as source, tarfile.open(to, "w:gz") as target:
        for member in source.getmembers():
            file = source.extractfile(member)
            assert file is not None
            new = change(member.name, file.read())
            if new is not None:
                info, content = new
                info.size = len(content) if info.isreg() else 0
                target.addfile(info, io.BytesIO(content))
    return to


@contextmanager
def running(state_dir: Path) -> Iterator[None]:
    """Hold the lock of a gateway that runs."""
    with (state_dir / "gateway.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def lock_of(state_dir: Path, starter: str) -> dict[str, Any] | None:
    stored = read_document(state_dir / STATE_FILE, LOCKS, MOTORS)
    assert stored is not None
    lock = stored.starters[starter].lock
    return None if lock is None else lock.model_dump()


def renamed(name: str, content: bytes) -> tuple[tarfile.TarInfo, bytes]:
    return tarfile.TarInfo(name), content


def with_names(old: str, new: str) -> Callable[[str, bytes], tuple[tarfile.TarInfo, bytes]]:
    def change(name: str, content: bytes) -> tuple[tarfile.TarInfo, bytes]:
        if name == "manifest.json":
            return renamed(name, content.replace(json.dumps(old).encode(), json.dumps(new).encode()))
        return renamed(new if name == old else name, content)

    return change


def build_site(folder: Path) -> Path:
    """Make a configuration with a secret, a file elsewhere, and the state of a gateway that has worked."""
    outside, folder = folder / "ssl", folder / "etc"
    (folder / "secret").mkdir(parents=True)
    outside.mkdir()
    (outside / "ca.pem").write_text("authority")
    (folder / "secret" / "mqtt.password").write_text("hunter2\n")
    (folder / "secret" / "mqtt.password").chmod(0o600)
    (folder / "site.toml").write_text(CONFIG.replace("OUTSIDE", str(outside)))
    (folder / "site.toml").chmod(0o640)
    (folder / "state").mkdir()
    shutil.copy(unpack_golden(folder.parent / "golden") / "history.db", folder / "state" / "history.db")
    shutil.rmtree(folder.parent / "golden")
    _store(folder / "state" / STATE_FILE)
    return folder / "site.toml"


def _store(path: Path) -> None:
    """Write what a gateway stores: a start and a lock, counts, the number of a birth, a command."""
    motors = MotorHistory(["pump", "mill"])
    motors.note_start("pump", now_s=90.0)
    motors.set_lock("mill", LockRecord(by="alice", since_s=UTC_S, reason="bearing"))
    stored = motors.stored(now_s=100.0, reading=ClockReading(100.0, UTC_S, "boot"))
    write_document(path, LOCKS, MOTORS, stored)
    write_document(path, "writes", WRITES, {"pump": 1})
    write_document(path, BIRTHS, NUMBER, 7)
    append_note(path, "gateway_started", "version 0.3.0")
    with closing(sqlite3.connect(path)) as connection, connection:
        values = ("alice", "c2", "pump", "start", "confirmed", "ok", "done", UTC_S, "{}", 1, 1, UTC_S)
        connection.execute(f"INSERT INTO commands VALUES ({', '.join('?' * len(values))})", values)
