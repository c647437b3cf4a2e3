"""Which files of a state directory are the gateway's, and which versions they have."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from gateway.errors import NewerError
from gateway.store.database import newer_text, stored_version
from gateway.store.import_0_2 import files_of_0_2, is_import_due
from gateway.store.schema import SCHEMAS

LOCK_FILE = "gateway.lock"
OTHERS = 0o077

# Also SQLite's journals, the reserve, and new and damaged files.
OWN_NAMES = re.compile(rf"({'|'.join(map(re.escape, (*SCHEMAS, LOCK_FILE)))})([.-].*)?")


def own_files(state_dir: Path) -> Iterator[Path]:
    """Yield what is a gateway's own in a folder, whatever it is: a folder may be in the way of a file."""
    yield from (path for path in state_dir.iterdir() if OWN_NAMES.fullmatch(path.name))
    yield from (state_dir / name for name in files_of_0_2(state_dir))


def found_versions(state_dir: Path) -> dict[str, int]:
    """Return the version of each file that is there and can be read, by name."""
    versions = {name: stored_version(state_dir / name, schema) for name, schema in SCHEMAS.items()}
    return {name: version for name, version in versions.items() if version is not None}


def refuse_newer(state_dir: Path, versions: Mapping[str, int] | None = None) -> None:
    """Raise NewerError, naming every file that a later version of this program has written.

    Without `versions`, of those that are there.
    """
    if versions is None:
        versions = found_versions(state_dir)
    texts = [
        newer_text(state_dir / name, version, SCHEMAS[name])
        for name, version in versions.items()
        if name in SCHEMAS and version > len(SCHEMAS[name].steps)
    ]
    if texts:
        raise NewerError("\n".join(texts))


def is_upgrade_due(state_dir: Path) -> bool:
    """Return whether a file is of an earlier version, or all are."""
    found = found_versions(state_dir)
    return is_import_due(state_dir) or any(found[name] < len(SCHEMAS[name].steps) for name in found)


def keep_private(folder: Path) -> None:
    """Give the gateway's own files in a folder mode 0600, also those that this process makes from now on.

    All others are left as they are: the folder may be one that other programs use too. So is what belongs to
    another user; folders keep their modes.
    """
    os.umask(OTHERS)
    with suppress(OSError):
        for path in list(own_files(folder)):
            with suppress(OSError):
                if path.lstat().st_mode & OTHERS and path.is_file() and not path.is_symlink():
                    path.chmod(0o600)
