"""How the gateway is: clock and broker, health, what a bug report needs, and `check` and `doctor`."""

from __future__ import annotations

import asyncio
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gateway import __version__
from gateway.contract import StatusRecord, rfc3339
from gateway.plugins.interface import Gateway
from gateway.plugins.web.plugin import WebSettings

MOVES_WITHIN_S = 3.0  # a line that has nothing to ask looks at its port once a second
MOVE_LOOK_S = 0.05
TOOL_WITHIN_S = 120.0
MOST_OUTPUT = 200_000  # characters


async def health(gateway: Gateway) -> tuple[bool, dict[str, Any]]:
    """Return whether all is well, and the state, each line, the broker; waits for lines that idle."""
    status = gateway.latest.find(StatusRecord.TOPIC)
    state = status.state if isinstance(status, StatusRecord) else "unknown"
    before = gateway.progress()
    lines = dict.fromkeys(before, False)
    for _ in range(int(MOVES_WITHIN_S / MOVE_LOOK_S)):
        await asyncio.sleep(MOVE_LOOK_S)
        lines = {name: steps != before.get(name) for name, steps in gateway.progress().items()}
        if all(lines.values()):
            break
    is_well = state in ("online", "degraded") and all(lines.values())
    return is_well, {"state": state, "lines": lines, "broker": gateway.mqtt.is_connected()}


def diagnostics(settings: WebSettings, gateway: Gateway) -> dict[str, Any]:
    """Return what a bug report needs besides all topics, without secrets; takes long."""
    config = settings.config.model_dump(mode="json", by_alias=True)
    for user in (config.get("web") or {}).get("user", ()):
        user["password"] = "(left out)"
    return {
        "clock": {"time": rfc3339(gateway.clock.utc_s()), "doubt": gateway.clock_doubt()},
        "broker": {"connected": gateway.mqtt.is_connected()},
        "version": __version__,
        "python": platform.python_version(),
        "system": platform.platform(),
        "config": config,
        "computed": dict(settings.computed),
    }


def run_tool(name: str, path: Path | None, options: Sequence[str]) -> dict[str, Any]:
    """Return exit code and output of a command on this configuration, in a process that yields to others."""
    if path is None:
        return {"code": 1, "output": "the configuration has no file here", "time": None, "took_s": 0.0}
    path = path.resolve()
    command = ["nice", "-n", "19", sys.executable, "-m", "gateway", name, str(path), *options]
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
