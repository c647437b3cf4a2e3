"""Which versions the files of a state directory have; nothing is changed here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gateway.errors import NewerError
from gateway.store import SCHEMAS, newer_text, stored_version


def refuse_newer(state_dir: Path) -> None:
    """Raise NewerError, naming every file that a later version of this program has written."""
    newer = [
        newer_text(state_dir / name, version, SCHEMAS[name])
        for name, version in found_in(state_dir)
        if version > len(SCHEMAS[name].steps)
    ]
    if newer:
        raise NewerError("\n".join(newer))


def found_in(state_dir: Path) -> Iterator[tuple[str, int]]:
    """Yield the name of each file that is there and can be read, with its version."""
    for name, schema in SCHEMAS.items():
        version = stored_version(state_dir / name, schema)
        if version is not None:
            yield name, version
