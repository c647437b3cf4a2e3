"""A site that is backed up, and what a test looks at in a backup and in what comes back."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Any

from gateway.starters.policy.motor_history import LOCKS, MOTORS
from gateway.store import STATE_FILE, read_document
from gateway.store.backup import upgrade
from tests.rig import Ran, run_cli
from tests.rig.sites import PASSWORD_LINE, line, operator, starter, table
from tests.store.golden.state import unpack_golden

CONFIG = (
    table("gateway", name="plant", state_dir="state")
    + table(
        "mqtt",
        url="mqtts://broker.plant",
        username="plant",
        password_file="secret/mqtt.password",
        ca_file="DIR/ssl/ca.pem",
    )
    + "[web]\n"
    + table("[web.user]", name="ann", operator="alice", password=PASSWORD_LINE)
    + line("hall")
    + starter("pump", 1, "ssw07")
    + starter("mill", 3, "ssw900")
    + operator("alice")
)


class BackupSite:
    """A configuration with a secret, a file elsewhere, and the state of a gateway that has worked."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.config, self.state = folder / "etc" / "site.toml", folder / "etc" / "state"
        files = (
            ("ssl/ca.pem", "authority", 0o644),
            ("etc/secret/mqtt.password", "hunter2\n", 0o600),
            ("etc/site.toml", CONFIG.replace("DIR", str(folder)), 0o640),
        )
        for name, text, mode in files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
            (folder / name).chmod(mode)
        upgrade(unpack_golden(self.state))

    def cli(self, words: str, code: int = 0, *, err: str = "") -> Ran:
        """Run a line, which must end so and complain so; SITE is the configuration, DIR the folder."""
        ran = run_cli(*words.replace("SITE", str(self.config)).replace("DIR", str(self.folder)).split())
        assert ran.code == code, ran
        assert err in ran.err if err else not ran.err, ran
        return ran

    def change(self, old: str, new: str) -> None:
        """Change the configuration; DIR is the folder."""
        old, new = (text.replace("DIR", str(self.folder)) for text in (old, new))
        text = self.config.read_text()
        assert old in text
        self.config.write_text(text.replace(old, new))

    def files(self) -> dict[str, bytes]:
        """Return all files below the folder, by their names there."""
        paths = (path for path in self.folder.rglob("*") if path.is_file())
        return {str(path.relative_to(self.folder)): path.read_bytes() for path in paths}


def names_in(path: Path) -> list[str]:
    with tarfile.open(path) as archive:
        return archive.getnames()


def manifest_of(path: Path) -> dict[str, Any]:
    with tarfile.open(path) as archive:
        source = archive.extractfile("manifest.json")
        assert source is not None
        found: dict[str, Any] = json.load(source)
        return found


def lock_of(state_dir: Path, starter: str) -> dict[str, Any]:
    stored = read_document(state_dir / STATE_FILE, LOCKS, MOTORS)
    lock = None if stored is None else stored.starters[starter].lock
    return {} if lock is None else lock.model_dump()
