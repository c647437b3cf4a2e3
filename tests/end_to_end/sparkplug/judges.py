"""The judges that `get-judges.sh` fetches: where they are, and how they are asked."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
BUILD = ROOT / "build" / "sparkplug"
PYTHON = BUILD / "venv" / "bin" / "python"
PATIENCE_S = 20.0

_DECODE = """
const payload = require("sparkplug-payload").get("spBv1.0");
const lines = require("fs").readFileSync(0, "utf8").split("\\n").filter(Boolean);
const plain = (_, value) => (value && value.high !== undefined) ? Number(value) : value;
for (const line of lines) {
    console.log(JSON.stringify(payload.decodePayload(Buffer.from(line, "hex")), plain));
}
"""
_AGAIN = """
import sys
from tahu import sparkplug_b_pb2
for line in sys.stdin:
    message = sparkplug_b_pb2.Payload()
    message.ParseFromString(bytes.fromhex(line))
    message.DiscardUnknownFields()
    print(message.SerializeToString(deterministic=True).hex())
"""

npm_judge = pytest.mark.skipif(
    shutil.which("node") is None or not (BUILD / "npm" / "node_modules" / "sparkplug-payload").is_dir(),
    reason="sparkplug-payload of npm is not installed",
)
python_judges = pytest.mark.skipif(
    not (BUILD / "venv" / ".installed").exists(), reason="mqtt-spb-wrapper and tahu are not installed"
)


def decoded_by_npm(payloads: list[bytes]) -> list[dict[str, Any]]:
    """Return what npm's sparkplug-payload reads."""
    said = _ask(["node", "-e", _DECODE], payloads, cwd=BUILD / "npm")
    return [json.loads(line) for line in said]


def written_again_by_tahu(payloads: list[bytes]) -> list[bytes]:
    """Return what Tahu's generated module makes of payloads that it has read."""
    return [bytes.fromhex(line) for line in _ask([str(PYTHON), "-c", _AGAIN], payloads)]


def _ask(command: list[str], payloads: list[bytes], *, cwd: Path = BUILD) -> list[str]:
    environ = {**os.environ, "PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION": "python"}
    lines = "".join(f"{payload.hex()}\n" for payload in payloads)
    done = subprocess.run(
        command,
        input=lines,
        cwd=cwd,
        env=environ,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    return done.stdout.splitlines()
