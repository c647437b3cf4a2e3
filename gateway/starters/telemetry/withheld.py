"""What a starter was read to say before it is known which device answers; pure.

A device of another family gives numbers for the same registers, and a larger model the same numbers with
another scale (ssw06-es 4.4). So nothing of a starter is published as good until it has said who it is, or was
asked so often that it counts as one that does not (`identification.py`: REFUSED_ROUNDS, GIVEN_UP_ROUNDS).
What was read meanwhile is then decoded for the variant that answers.
"""

from __future__ import annotations

from collections.abc import Mapping

Rows = Mapping[str, tuple[int, ...]]


class Withheld:
    """The latest rows of each read of one starter while its identity is open, as it is at the beginning."""

    def __init__(self) -> None:
        self.is_open = True
        self._latest: dict[tuple[str, ...], tuple[float, Rows]] = {}

    def put(self, rows: Rows, *, at_s: float) -> None:
        """Keep what was just read, instead of what the same rows said before."""
        self._latest[tuple(rows)] = (at_s, rows)

    def withhold(self) -> None:
        """Begin anew: the identity is open again."""
        self.is_open = True
        self._latest.clear()

    def release(self) -> list[tuple[float, Rows]]:
        """Return what was kept, the oldest first; from now on nothing is withheld."""
        self.is_open = False
        kept = sorted(self._latest.values(), key=lambda each: each[0])
        self._latest.clear()
        return kept
