"""Every file of a state directory, and the format that this program reads and writes.

A file of a later format than this program's is never opened, set aside or overwritten.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from gateway.errors import NewerError
from gateway.store import SCHEMAS, newer_text, stored_version

LOCK_FILE = "gateway.lock"
OTHERS = 0o077

# Also SQLite's journals, the reserve, and new and damaged files.
OWN_NAMES = re.compile(rf"({'|'.join(re.escape(name) for name in (*SCHEMAS, LOCK_FILE))})([.-].*)?")


def require_known(path: Path, version: int) -> None:
    """Raise NewerError for a file that a later version of this program has written."""
    if version > len(SCHEMAS[path.name].steps):
        raise NewerError(newer_text(path, version, SCHEMAS[path.name]))


def keep_private(folder: Path) -> None:
    """Give the gateway's own files in a folder mode 0600, also those that this process makes from now on.

    All others are left as they are: the folder may be one that other programs use too. So is what belongs to
    another user; folders keep their modes.
    """
    os.umask(OTHERS)
    with suppress(OSError):
        for path in [path for path in folder.iterdir() if OWN_NAMES.fullmatch(path.name)]:
            with suppress(OSError):
                if path.lstat().st_mode & OTHERS and path.is_file() and not path.is_symlink():
                    path.chmod(0o600)


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
