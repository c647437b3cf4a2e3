"""The commands `check` and `doctor` for the status page, each in a process that yields to all others."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from gateway.contract import rfc3339
from gateway.plugins.web.interface import ToolBusyError

TOOL_WITHIN_S = 120.0
MOST_OUTPUT = 200_000  # characters


class Tools:
    """Runs one at a time; on the application's loop."""

    def __init__(self) -> None:
        self._is_running = False

    async def run(self, name: str, path: Path | None) -> dict[str, Any]:
        """Return exit code and output of a command on this configuration; ToolBusyError while one runs."""
        if self._is_running:
            raise ToolBusyError
        if path is None:
            return {"code": 1, "output": "the configuration has no file here", "time": None, "took_s": 0.0}
        self._is_running = True
        try:
            return await asyncio.to_thread(_run_tool, name, path)
        finally:
            self._is_running = False


def _run_tool(name: str, path: Path) -> dict[str, Any]:
    path = path.resolve()
    nice = shutil.which("nice")
    command = [*([nice, "-n", "19"] if nice else []), sys.executable, "-m", "gateway", name, str(path)]
    began_s = time.monotonic()
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=TOOL_WITHIN_S,
            check=False,
            cwd=path.parent,
        )
        code, output = done.returncode, done.stdout.decode("utf-8", "replace")
    except subprocess.TimeoutExpired:
        code, output = 1, f"not done within {TOOL_WITHIN_S:g} s"
    except OSError as error:
        code, output = 1, f"cannot be run here: {error}"
    took_s = round(time.monotonic() - began_s, 1)
    return {"code": code, "output": output[-MOST_OUTPUT:], "time": rfc3339(time.time()), "took_s": took_s}
