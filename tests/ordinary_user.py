"""What an ordinary user may do, also when root runs the tests: a program gives its rights up first."""

from __future__ import annotations

import concurrent.futures.thread  # noqa: F401 - imported late else, and perhaps from where only root may read
import os
from pathlib import Path

UNPRIVILEGED = 65534  # Debian's user and group without rights


def become_ordinary() -> None:
    """Go on without root's rights; to be called in a process of its own."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(UNPRIVILEGED)
        os.setuid(UNPRIVILEGED)


def give(path: str | Path) -> None:
    """Let the ordinary user own a file or folder."""
    if os.geteuid() == 0:
        os.chown(path, UNPRIVILEGED, UNPRIVILEGED)
