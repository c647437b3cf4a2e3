"""The examples of docs/clients.md, and the flow that it names."""

from __future__ import annotations

import re
from pathlib import Path

TOP = Path(__file__).parents[1]
PAGE = (TOP / "docs" / "clients.md").read_text("utf-8")
FLOW = (TOP / "deploy" / "contrib" / "node-red" / "flow.json").read_text("utf-8")


def example(language: str) -> str:
    """Return the first example in a language."""
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]
