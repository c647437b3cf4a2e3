"""What docs/tutorial.md says to type: its commands in order, and the files that it shows."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tutorial.md"
NEEDS_ROOT = ("sudo ", "systemctl ", "journalctl ", "udevadm ")  # or a machine that is set up


def commands() -> list[str]:
    """Return every line of the page's sh blocks, in order."""
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    return [line for block in blocks for line in block.splitlines() if line.strip()]


def runnable() -> list[str]:
    """Return the commands that an ordinary user can run anywhere, the simulator included."""
    return [line for line in commands() if not line.startswith(NEEDS_ROOT)]


def file(title: str) -> str:
    """Return the text of a file that the page shows."""
    pattern = rf'^```\w+ title="{re.escape(title)}"\n(.*?)^```'
    found = re.search(pattern, PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    assert found is not None, title
    return found[1]
