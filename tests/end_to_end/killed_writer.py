"""A process that writes until it is killed."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from pathlib import Path

LINES = (1, 41)  # that are waited for, now few and now many, however quick the machine is


def write_until_killed(
    module: str, path: Path, number: int, dice: random.Random, longest_s: float
) -> list[str]:
    """Let a writer of `tests.end_to_end` write LINES and a while longer, kill it; return what it printed."""
    least, after_s, run = LINES[number % len(LINES)], dice.uniform(0.0, longest_s), f"run{number}"
    command = [sys.executable, "-m", f"tests.end_to_end.{module}", str(path), run]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        written = [writer.stdout.readline().strip() for _ in range(least)]  # it has begun
        try:
            writer.wait(after_s)
        except subprocess.TimeoutExpired:
            writer.kill()
        written += writer.stdout.read().splitlines()
    assert writer.returncode == -signal.SIGKILL
    return written
