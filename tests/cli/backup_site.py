"""A site that is backed up, and what a test looks at in a backup and in what comes back."""

from __future__ import annotations

import fcntl
import io
import json
import tarfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gateway.starters.policy.motor_history import LOCKS, MOTORS
from gateway.store import STATE_FILE, read_document
from gateway.store.backup import upgrade
from tests.rig.sites import PASSWORD_LINE, line, operator, starter, table
from tests.store.golden.state import unpack_golden

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
    + table("[web.user]", name="ann", operator="alice", password=PASSWORD_LINE)
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
    upgrade(unpack_golden(folder / "state"))
    return folder / "site.toml"
