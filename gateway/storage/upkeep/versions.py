"""Which versions the files of a state directory have; nothing is changed here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from gateway.errors import NewerError
from gateway.storage.database import stored_version
from gateway.storage.formats.catalogue import FORMATS, FileKind, Format, newer_text
from gateway.storage.json_file import JsonFile


class Pending(NamedTuple):
    """A file that the next start converts."""

    format: Format
    version: int  # it has
    octets: int


def refuse_newer(state_dir: Path) -> None:
    """Raise NewerError, naming every file that a later version of this program has written."""
    texts = [newer_text(state_dir / each.name, version, each) for each, version in found_in(state_dir)]
    newer = [text for text in texts if text]
    if newer:
        raise NewerError("\n".join(newer))


def pending_in(state_dir: Path) -> list[Pending]:
    """Return what the next start converts, after making a copy of each."""
    return [
        Pending(each, version, (state_dir / each.name).stat().st_size)
        for each, version in found_in(state_dir)
        if version < each.version
    ]


def found_in(state_dir: Path) -> Iterator[tuple[Format, int]]:
    """Yield each file that is there and can be read, with its version."""
    for each in FORMATS.values():
        version = version_of(state_dir / each.name, each)
        if version is not None:
            yield each, version


def version_of(path: Path, format_: Format) -> int | None:
    """Return the version of a file; None when there is none, or none that can be read."""
    return stored_version(path) if format_.kind is FileKind.SQLITE else JsonFile(path).version()
