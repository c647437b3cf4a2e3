"""The standing faults whose events were published, also by an earlier run: the next one repeats none.

The document is saved `LASTING_S` after a change: an event is on the disk long before, so that none is lost
by being counted as published. A run that is killed before that has the next one publish it once more.
"""

from __future__ import annotations

from pydantic import TypeAdapter

from gateway.store import Documents

FAULTS = TypeAdapter(dict[str, tuple[str, ...]])  # codes by starter
LASTING_S = 5.0


class PublishedFaults:
    """Of all starters, by name."""

    def __init__(self, documents: Documents | None = None) -> None:
        self._document = (documents or Documents()).open(
            "faults", FAULTS, lambda: self._codes, delay_s=LASTING_S
        )
        self._codes = self._document.loaded or {}

    def of(self, starter: str) -> tuple[str, ...]:
        """Return the codes of the fault that was published; empty for none."""
        return self._codes.get(starter, ())

    def note(self, starter: str, codes: tuple[str, ...]) -> None:
        """Record the fault that stands and was published; empty when there is none."""
        if self.of(starter) == codes:
            return
        if codes:
            self._codes[starter] = codes
        else:
            del self._codes[starter]
        self._document.touch()
