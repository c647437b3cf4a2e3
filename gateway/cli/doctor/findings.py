"""Findings of `doctor`, `check` and `broker-kit`: one form, one printer, one rule for the exit code."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.cli.command import counted
from gateway.families import Weight


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing looked at; `weight` is None when all is well."""

    where: str
    text: str
    weight: Weight | None = None
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.weight or 'ok':8}{self.said}"

    @property
    def said(self) -> str:
        """Return the finding without its weight."""
        return f"{self.where}: {self.text}" + (f" ({self.remedy})" if self.remedy else "")


class Findings:
    """Prints each finding at once, and counts those on which a person should act."""

    def __init__(self) -> None:
        self._count = dict.fromkeys((Weight.ERROR, Weight.WARNING), 0)

    def add(self, *found: Finding | None) -> None:
        """Print findings; None is nothing to be said."""
        for finding in filter(None, found):
            print(finding, flush=True)
            if finding.weight in self._count:
                self._count[finding.weight] += 1

    def verdict(self) -> int:
        """Print how many problems there are, and return the exit code: 1 when there is one."""
        counts = [counted(number, str(weight)) for weight, number in self._count.items()]
        print(", ".join(counts) if any(self._count.values()) else "no problems")
        return int(any(self._count.values()))
