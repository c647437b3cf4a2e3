"""Files of the state directory are readable by their owner only: they contain ids, operators and reasons."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

OTHERS = 0o077


def keep_private(folder: Path) -> None:
    """Give the files below a folder mode 0600, also those that this process makes from now on.

    What belongs to another user is left as it is; the folders keep their modes.
    """
    os.umask(OTHERS)
    for place, _, names in os.walk(folder):
        for name in names:
            path = Path(place, name)
            with suppress(OSError):
                if path.lstat().st_mode & OTHERS and path.is_file() and not path.is_symlink():
                    path.chmod(0o600)
