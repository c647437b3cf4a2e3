"""Every file of a state directory, and the format that this program reads and writes.

A file that names no format has the first. A file of a later format than this program's is never opened, set
aside or overwritten.
"""

from __future__ import annotations

import enum
import re
from dataclasses import dataclass
from pathlib import Path

from gateway.errors import NewerError

FORMAT = 1  # of every file
KEY = "version"  # of a JSON document; SQLite has PRAGMA user_version


class FileKind(enum.Enum):
    """How a file says its format, and how a consistent copy of it is made."""

    SQLITE = "sqlite"
    JSON = "json"


@dataclass(frozen=True, slots=True)
class StateFile:
    """One file; `name` is its path in the state directory."""

    name: str
    kind: FileKind


STATE_FILES = {
    Path(each.name).name: each
    for each in (
        StateFile("gateway.sqlite", FileKind.SQLITE),
        StateFile("outbox.sqlite", FileKind.SQLITE),
        StateFile("history.db", FileKind.SQLITE),
        StateFile("precautions.json", FileKind.JSON),
        StateFile("identities.json", FileKind.JSON),
        StateFile("watchdogs.json", FileKind.JSON),
        StateFile("faults.json", FileKind.JSON),
        StateFile("wear.json", FileKind.JSON),
        StateFile("home-assistant.json", FileKind.JSON),
        StateFile("sparkplug/bdseq.json", FileKind.JSON),
    )
}
LOCK_FILE = "gateway.lock"

# Also SQLite's journals, and new and damaged files.
OWN_NAMES = re.compile(rf"({'|'.join(re.escape(name) for name in (*STATE_FILES, LOCK_FILE))})([.-].*)?")


def newer_text(path: Path, version: int) -> str:
    """Return what is wrong with a file that a later version of this program has written; empty: nothing."""
    if version <= FORMAT:
        return ""
    return (
        f"{path} has format {version}, and this program knows formats up to {FORMAT} "
        "(install the version that wrote it, or restore a backup of before: docs/upgrade.md)"
    )


def require_known(path: Path, version: int) -> None:
    """Raise NewerError for a file that a later version of this program has written."""
    if text := newer_text(path, version):
        raise NewerError(text)
