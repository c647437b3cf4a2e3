"""Every file of a state directory: its version, and the steps that lead to it from earlier ones.

A format that changes gets one more step, and with it the next version. Files of before there were versions
count as version 1. A later version than this program's is never opened, set aside or overwritten.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gateway.errors import NewerError

FIRST = 1
KEY = "version"  # of a JSON document; SQLite has PRAGMA user_version

Step = Callable[[Any], Any]  # from one version to the next: a document to a document, or on a connection


class FileKind(enum.Enum):
    """How a file says its version, and how a consistent copy of it is made."""

    SQLITE = "sqlite"
    JSON = "json"


@dataclass(frozen=True, slots=True)
class Format:
    """One file; `name` is its path in the state directory."""

    name: str
    kind: FileKind
    steps: tuple[Step, ...] = ()
    is_of_box: bool = False  # says something of this machine only: no backup has it

    @property
    def version(self) -> int:
        """Return the version that this program writes."""
        return FIRST + len(self.steps)

    def steps_from(self, version: int) -> Sequence[Step]:
        """Return the steps that lead from an earlier version to the present one, in order."""
        return self.steps[version - FIRST :]


FORMATS = {
    Path(each.name).name: each
    for each in (
        Format("gateway.sqlite", FileKind.SQLITE),
        Format("outbox.sqlite", FileKind.SQLITE),
        Format("history.db", FileKind.SQLITE),
        Format("precautions.json", FileKind.JSON),
        Format("identities.json", FileKind.JSON),
        Format("watchdogs.json", FileKind.JSON),
        Format("faults.json", FileKind.JSON),
        Format("wear.json", FileKind.JSON),
        Format("home-assistant.json", FileKind.JSON),
        Format("sparkplug/bdseq.json", FileKind.JSON),
        Format("restart.json", FileKind.JSON, is_of_box=True),
    )
}
LOCK_FILE = "gateway.lock"

# Also SQLite's journals, copies of earlier versions, and new and damaged files.
OWN_NAMES = re.compile(rf"({'|'.join(re.escape(name) for name in (*FORMATS, LOCK_FILE))})([.-].*)?")


def format_of(path: Path, kind: FileKind) -> Format:
    """Return the format of a file, which its name says; a file of another name has the first version."""
    return FORMATS.get(path.name) or Format(path.name, kind)


def newer_text(path: Path, version: int, known: Format) -> str:
    """Return what is wrong with a file that a later version of this program has written; empty: nothing."""
    if version <= known.version:
        return ""
    return (
        f"{path} has format {version}, and this program knows formats up to {known.version} "
        "(install the version that wrote it, or go back to the copies of before: docs/upgrade.md)"
    )


def require_known(path: Path, version: int, known: Format) -> None:
    """Raise NewerError for a file that a later version of this program has written."""
    text = newer_text(path, version, known)
    if text:
        raise NewerError(text)


def copy_path(path: Path, version: int) -> Path:
    """Return where the copy of a file of an earlier version is."""
    return path.with_name(f"{path.name}.{version}")


def other_copies(path: Path, version: int) -> list[Path]:
    """Return the copies of all versions but this one: only one generation stays."""
    numbered = re.compile(rf"{re.escape(path.name)}\.([1-9][0-9]*)(\.new)?")
    matches = ((each, numbered.fullmatch(each.name)) for each in path.parent.iterdir())
    return [each for each, match in matches if match and (int(match[1]) != version or match[2])]
