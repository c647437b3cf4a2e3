"""Wireshark's own reading of a capture."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.capture import READ_WITH


def need_tshark() -> str:
    """Return tshark's path; skips the test by name where there is none, but fails it in CI."""
    program = shutil.which("tshark")
    if program is None:
        text = "not installed: tshark (apt-get install tshark)"
        if os.environ.get("CI") == "true":
            pytest.fail(text)
        pytest.skip(text)
    return program


def dissect(path: Path) -> list[dict[str, Any]]:
    """Return the frames of a capture as tshark dissects them, with the options that `capture` names."""
    options = READ_WITH.split()
    done = subprocess.run(
        [need_tshark(), "-r", str(path), *options, "-T", "json"], capture_output=True, text=True, check=True
    )
    return [each["_source"]["layers"] for each in json.loads(done.stdout)]


def summaries(path: Path) -> list[str]:
    """Return tshark's one line about each frame."""
    options = ["-T", "fields", "-e", "_ws.col.Info"]
    done = subprocess.run(
        [need_tshark(), "-r", str(path), *READ_WITH.split(), *options],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()
