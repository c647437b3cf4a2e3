"""What the documents show in blocks, and the flow for Node-RED that they name."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FLOW = (ROOT / "deploy" / "contrib" / "node-red" / "flow.json").read_text("utf-8")
NEEDS_ROOT = ("sudo ", "systemctl ", "journalctl ", "udevadm ")  # or a machine that is set up


def blocks(page: str, head: str) -> list[str]:
    """Return the blocks of a page that begin with a language, or with more."""
    text = (ROOT / "docs" / page).read_text("utf-8")
    return re.findall(rf"```{re.escape(head)}\n(.*?)```", text, re.DOTALL)


def tutorial_commands() -> list[str]:
    """Return what the tutorial says to type and an ordinary user can run anywhere, the simulator included."""
    lines = [line for block in blocks("tutorial.md", "sh") for line in block.splitlines()]
    return [line for line in lines if line.strip() and not line.startswith(NEEDS_ROOT)]


def tutorial_config() -> str:
    """Return the configuration that the tutorial shows."""
    (text,) = blocks("tutorial.md", 'toml title="site.toml"')
    return text
