"""A process that writes until it is killed."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path


def write_until_killed(module: str, path: Path, run: str, after_s: float) -> list[str]:
    """Let a writer of `tests.end_to_end` write for a while, kill it, and return what it said was kept."""
    command = [sys.executable, "-m", f"tests.end_to_end.{module}", str(path), run]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        told = [writer.stdout.readline().strip()]  # it has begun
        try:
            writer.wait(after_s)
        except subprocess.TimeoutExpired:
            writer.kill()
        told += writer.stdout.read().splitlines()
    assert writer.returncode == -signal.SIGKILL
    return told
