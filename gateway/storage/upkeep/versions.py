"""Which versions the files of a state directory have; nothing is changed here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gateway.errors import NewerError
from gateway.storage.database import stored_version
from gateway.storage.formats import STATE_FILES, FileKind, StateFile, newer_text
from gateway.storage.json_file import JsonFile


def refuse_newer(state_dir: Path) -> None:
    """Raise NewerError, naming every file that a later version of this program has written."""
    texts = [newer_text(state_dir / each.name, version) for each, version in found_in(state_dir)]
    newer = [text for text in texts if text]
    if newer:
        raise NewerError("\n".join(newer))


def found_in(state_dir: Path) -> Iterator[tuple[StateFile, int]]:
    """Yield each file that is there and can be read, with its version."""
    for each in STATE_FILES.values():
        version = version_of(state_dir / each.name, each.kind)
        if version is not None:
            yield each, version


def version_of(path: Path, kind: FileKind) -> int | None:
    """Return the version of a file; None when there is none, or none that can be read."""
    return stored_version(path) if kind is FileKind.SQLITE else JsonFile(path).version()
