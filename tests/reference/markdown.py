"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable


def table(title: str, head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """Return a table under its title, an empty line behind it; bars in cells are escaped."""
    cells = (" | ".join(cell.replace("|", "\\|") for cell in row) for row in (head, *rows))
    first, *others = (f"| {each} |" for each in cells)
    return "\n".join([title, "", first, "|" + "---|" * len(head), *others, ""])
