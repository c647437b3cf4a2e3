"""Every file of a state directory, and the format that this program reads and writes.

A file of a later format than this program's is never opened, set aside or overwritten.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

from gateway.errors import NewerError
from gateway.store import STATE, STATE_FILE

STATE_FILES = {STATE_FILE: len(STATE.steps), "history.db": 1}  # the newest known formats
FORMAT = 1  # of the last
LOCK_FILE = "gateway.lock"
OTHERS = 0o077

# Also SQLite's journals, the reserve, and new and damaged files.
OWN_NAMES = re.compile(rf"({'|'.join(re.escape(name) for name in (*STATE_FILES, LOCK_FILE))})([.-].*)?")


def newer_text(path: Path, version: int) -> str:
    """Return what is wrong with a file that a later version of this program has written; empty: nothing."""
    known = STATE_FILES.get(path.name, FORMAT)
    if version <= known:
        return ""
    return (
        f"{path} has format {version}, and this program knows formats up to {known} "
        "(install the version that wrote it, or restore a backup of before: docs/upgrade.md)"
    )


def require_known(path: Path, version: int) -> None:
    """Raise NewerError for a file that a later version of this program has written."""
    if text := newer_text(path, version):
        raise NewerError(text)


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
