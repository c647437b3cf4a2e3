"""One finding of `doctor`: a sentence about one thing, and whether it is a problem."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.families.devices.findings import Weight


@dataclass(frozen=True, slots=True)
class DoctorFinding:
    """One thing looked at; `weight` is None when all is well."""

    where: str
    text: str
    weight: Weight | None = None

    @property
    def is_problem(self) -> bool:
        """Return whether a person should act on it."""
        return self.weight in (Weight.WARNING, Weight.ERROR)

    def __str__(self) -> str:
        return f"{self.weight or 'ok':8}{self.where}: {self.text}"
