"""Tables for a terminal, and whether what was to be reached was reached. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Goal:
    """One row of what is to be reached."""

    what: str
    got: float
    limit: float
    is_most: bool = False  # False: at least the limit; True: at most
    unit: str = ""

    @property
    def is_met(self) -> bool:
        """Return whether it is reached; what was not measured is not."""
        return self.got <= self.limit if self.is_most else self.got >= self.limit

    def cells(self) -> tuple[str, ...]:
        """Return the row of a table."""
        return (
            self.what,
            f"{self.got:.4g}{self.unit}",
            f"{'<=' if self.is_most else '>='} {self.limit:.4g}{self.unit}",
            "met" if self.is_met else "MISSED",
        )


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], *, note: str = "") -> str:
    """Return a table as text: the first column to the left, the others to the right."""
    widths = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
    lines = [f"## {title}", ""]
    for row in (head, ["-" * width for width in widths], *rows):
        cells = [
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", note] if note else []
    return "\n".join([*lines, ""])
