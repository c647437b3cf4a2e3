"""Prometheus' own judges, from the distribution."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest


def program(name: str) -> str:
    """Return the path of a program of Debian's package prometheus; skip without it, and fail in CI."""
    path = shutil.which(name)
    if path is None:
        text = f"not installed: {name} (apt-get install prometheus)"
        if os.environ.get("CI") == "true":
            pytest.fail(text)
        pytest.skip(text)
    return path


def promtool(*arguments: str, folder: Path | None = None, standard_input: bytes = b"") -> str:
    """Run promtool; return what it says, and "" where it is content with metrics."""
    ran = subprocess.run(
        [program("promtool"), *arguments], cwd=folder, input=standard_input, capture_output=True, timeout=60
    )
    assert ran.returncode == 0, (ran.stdout + ran.stderr).decode()
    return (ran.stdout + ran.stderr).decode()
