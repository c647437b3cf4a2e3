"""The life of a command: which phase may follow which."""

from __future__ import annotations

from collections.abc import Mapping

from gateway.starters.records import Phase

NEXT: Mapping[Phase | None, frozenset[Phase]] = {
    None: frozenset({Phase.ACCEPTED, Phase.REJECTED}),  # just received
    Phase.ACCEPTED: frozenset(
        # confirmed without a write: a read, a value that already stood there, a motor that stands still
        {Phase.WRITTEN, Phase.CONFIRMED, Phase.REJECTED, Phase.FAILED}
    ),
    Phase.WRITTEN: frozenset({Phase.CONFIRMED, Phase.FAILED, Phase.UNCONFIRMED}),  # never "nothing written"
    Phase.CONFIRMED: frozenset(),
    Phase.REJECTED: frozenset(),
    Phase.FAILED: frozenset(),
    Phase.UNCONFIRMED: frozenset(),
}


class Life:
    """One command's phase; a step that the table does not list is a bug and raises ValueError."""

    def __init__(self, phase: Phase | None = None) -> None:
        self._phase = phase

    @property
    def phase(self) -> Phase | None:
        """Return the present phase; None before the first."""
        return self._phase

    @property
    def is_over(self) -> bool:
        """Return whether the final result has been given."""
        return self._phase is not None and self._phase.is_final

    @property
    def is_written(self) -> bool:
        """Return whether something has, or may have, reached the starter."""
        return self._phase is Phase.WRITTEN

    @classmethod
    def resumed(cls, *, may_be_written: bool) -> Life:
        """Return a life that a crash cut short after its acceptance: as far on as it can have been."""
        return cls(Phase.WRITTEN if may_be_written else Phase.ACCEPTED)

    def advance(self, phase: Phase) -> None:
        """Go on to `phase`."""
        if phase not in NEXT[self._phase]:
            raise ValueError(f"a command cannot go from {self._phase} to {phase}")
        self._phase = phase
