"""Room on the disk that is given up while the disk is full: deleting rows needs room too.

A file beside the database, allocated and never written. There is enough room only when the disk has as much
left besides, so that a store on a full disk does not change its mind every few seconds.
"""

from __future__ import annotations

import os
from pathlib import Path

from gateway.system.whole_files import private

RESERVE_BYTES = 2**20


class Reserve:
    """The reserve of one database; of one in memory there is none to take."""

    def __init__(self, path: Path | None) -> None:
        self._path = None if path is None else path.with_name(f"{path.name}-reserve")

    @property
    def is_held(self) -> bool:
        """Return whether the room is taken, by this run or an earlier one."""
        try:
            return self._path is None or self._path.stat().st_size == RESERVE_BYTES
        except OSError:
            return False

    def take(self) -> bool:
        """Take the room, and return whether there is enough; OSError."""
        if self._path is None:
            return True
        disk, is_held = os.statvfs(self._path.parent), self.is_held
        if disk.f_bavail * disk.f_frsize < (1 if is_held else 2) * RESERVE_BYTES:
            return False
        if not is_held:
            with open(self._path, "wb", opener=private) as file:
                os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
        return True

    def give_up(self) -> bool:
        """Give the room back to the disk; return whether there was any."""
        is_held = self._path is not None and self.is_held
        if self._path is not None and is_held:
            os.truncate(self._path, 0)
        return is_held
