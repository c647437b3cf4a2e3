"""Prometheus' own judge, from the distribution."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.programs import program


def promtool(*arguments: str, folder: Path | None = None, standard_input: bytes = b"") -> str:
    """Run promtool; return what it says, and "" where it is content with metrics."""
    ran = subprocess.run(
        [program("promtool", "prometheus"), *arguments],
        cwd=folder,
        input=standard_input,
        capture_output=True,
        timeout=60,
    )
    assert ran.returncode == 0, (ran.stdout + ran.stderr).decode()
    return (ran.stdout + ran.stderr).decode()
