"""Gives a process a share of one processor by a control group, version 2 or 1; only root may make one.

A group's quota lets a process run for SLICE_S at full speed and then wait; a slower processor would spread
the same work. What takes less than SLICE_S is therefore faster here than on a slow box, the sum is the same.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

SLICE_S = 0.001  # the shortest quota that Linux takes
V2, V1 = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/cpu")


class Throttle:
    """One share for the processes that are started within `applied`; RuntimeError where there is no group."""

    def __init__(self, share: float) -> None:
        self.share = share
        self.how = "not throttled"
        self._folder: Path | None = None

    def __enter__(self) -> Throttle:
        if self.share < 1.0:
            self._folder = self._make()
        return self

    def __exit__(self, *_: object) -> None:
        if self._folder is not None:
            for _ in range(50):
                with suppress(OSError):  # while a process in it is still ending
                    self._folder.rmdir()
                    return
                time.sleep(0.1)

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Let what this process starts meanwhile have the share from its first instruction."""
        if self._folder is None:
            yield
            return
        own = os.getpid()
        home = _home_of(own, self._folder.parent)
        (self._folder / "cgroup.procs").write_text(str(own))
        try:
            yield
        finally:
            (home / "cgroup.procs").write_text(str(own))

    def _make(self) -> Path:
        period_us, quota_us = round(SLICE_S / self.share * 1e6), round(SLICE_S * 1e6)
        for top, version in ((V2, "2"), (V1, "1")):
            folder = top / f"slow-box-{os.getpid()}"
            controls = top / "cgroup.controllers"
            if version == "2" and not (controls.exists() and "cpu" in controls.read_text().split()):
                continue
            try:
                folder.mkdir()
                if version == "2":
                    (folder / "cpu.max").write_text(f"{quota_us} {period_us}")
                    (folder / "cpu.weight").write_text("10000")  # gets its share before other work
                else:
                    (folder / "cpu.cfs_period_us").write_text(str(period_us))
                    (folder / "cpu.cfs_quota_us").write_text(str(quota_us))
                    (folder / "cpu.shares").write_text("262144")
            except OSError:
                with suppress(OSError):
                    folder.rmdir()
                continue
            self.how = f"control group, version {version}: {quota_us} of {period_us} us"
            return folder
        raise RuntimeError("a share of a processor needs control groups, and root")


def _home_of(pid: int, top: Path) -> Path:
    """Return the group that a process is in now, of the hierarchy at `top`."""
    for line in Path(f"/proc/{pid}/cgroup").read_text().splitlines():
        number, controllers, path = line.split(":", 2)
        if (top == V2 and number == "0") or "cpu" in controllers.split(","):
            return top / path.lstrip("/")
    return top
