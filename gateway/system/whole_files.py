"""Files that appear whole or not at all, also over a power cut."""

from __future__ import annotations

import os
from pathlib import Path

NEW = ".new"  # ends the name of a file that is still being written


def private(path: str, flags: int) -> int:
    """Open a file that only the gateway's own user may read; for `open(opener=)`."""
    return os.open(path, flags, 0o600)


def put_in_place(new: Path, path: Path) -> None:
    """Rename a file that is on the disk already, and return when the name is as well; OSError."""
    new.replace(path)
    sync_file(path.parent)


def sync_file(path: Path) -> None:
    """Return when the content of a file, or the names in a folder, are on the disk; OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
