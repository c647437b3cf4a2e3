"""Which versions the files of a state directory have; nothing is changed here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from gateway import store
from gateway.errors import NewerError
from gateway.storage.formats import STATE_FILES, newer_text


def refuse_newer(state_dir: Path) -> None:
    """Raise NewerError, naming every file that a later version of this program has written."""
    texts = [newer_text(state_dir / name, version) for name, version in found_in(state_dir)]
    newer = [text for text in texts if text]
    if newer:
        raise NewerError("\n".join(newer))


def found_in(state_dir: Path) -> Iterator[tuple[str, int]]:
    """Yield the name of each file that is there and can be read, with its version."""
    for name in STATE_FILES:
        version = version_of(state_dir / name)
        if version is not None:
            yield name, version


def version_of(path: Path) -> int | None:
    """Return the version of a file; None when there is none, or none that can be read."""
    return store.stored_version(path, store.SCHEMAS[path.name])
