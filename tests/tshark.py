"""Wireshark's own reading of a capture, with the options that `capture` names."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from gateway.cli.capture import READ_WITH
from tests.programs import program


def dissect(path: Path) -> list[dict[str, Any]]:
    """Return the frames of a capture as tshark dissects them."""
    return [each["_source"]["layers"] for each in json.loads(_said(path, "json"))]


def summaries(path: Path) -> list[str]:
    """Return tshark's one line about each frame."""
    return _said(path, "fields", "-e", "_ws.col.Info").splitlines()


def _said(path: Path, *form: str) -> str:
    command = [program("tshark"), "-r", str(path), *READ_WITH.split(), "-T", *form]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
