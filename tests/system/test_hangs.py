"""A gateway that stands still says where; one that does so again and again does not fill the journal."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from gateway.system.stalls import QUIET_S, HangWatch


class Timer:
    """Stands for faulthandler's thread."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.due_s: float | None = None

    def arm(self, after_s: float, *, file: Any) -> None:
        assert file is sys.__stderr__
        self.due_s = self.now_s + after_s

    def disarm(self) -> None:
        self.due_s = None

    def watch(self, patience_s: float | None = 5.0) -> HangWatch:
        return HangWatch(patience_s, arm=self.arm, disarm=self.disarm, clock=lambda: self.now_s)


def test_a_stall_is_reported_once_and_dumped_again_only_after_a_while(
    caplog: pytest.LogCaptureFixture,
) -> None:
    timer = Timer()
    watch = timer.watch()
    watch.fed()

    timer.now_s += 6.0
    watch.fed()
    due_after_first_s = timer.due_s
    timer.now_s += 7.0
    watch.fed()
    timer.now_s += QUIET_S - 1.0
    watch.fed()
    timer.now_s += 0.5
    watch.fed()

    assert due_after_first_s is None
    assert watch.dumps == 3
    assert caplog.text.count("stood still") == 2


def test_the_real_timer_writes_the_stacks_of_all_threads_to_stderr() -> None:
    program = (
        "import time; from gateway.system.stalls import HangWatch\n"
        "def stuck():\n    time.sleep(0.6)\n"
        "watch = HangWatch(0.2)\nwatch.fed()\nstuck()\nwatch.fed()\nwatch.close()"
    )

    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert "Timeout" in done.stderr
    assert "in stuck" in done.stderr
    assert "Traceback" not in done.stderr
