"""How many of a starter's latest polls had no right reply: a poor line, which is not a lost starter; pure."""

from __future__ import annotations

from collections import deque

OF = 200  # polls are looked at
POOR, GOOD_AGAIN = 8, 3  # of them lost: from 4 % on it is said, until it is 1.5 % or less


class Loss:
    """Counts the lost polls of one starter among its latest."""

    def __init__(self) -> None:
        self._latest: deque[bool] = deque(maxlen=OF)
        self._lost = 0
        self._is_poor = False

    def note(self, *, is_lost: bool) -> str | None:
        """Count a poll; return what is wrong, "" once nothing is any more, None for no news."""
        if len(self._latest) == OF:
            self._lost -= self._latest[0]
        self._latest.append(is_lost)
        self._lost += is_lost
        was_poor = self._is_poor
        self._is_poor = self._lost >= POOR or (was_poor and self._lost > GOOD_AGAIN)
        if self._is_poor is was_poor:
            return None
        return (
            f"{self._lost} of its last {len(self._latest)} polls had no right reply" if self._is_poor else ""
        )

    def clear(self) -> None:
        """Count anew: the starter itself was lost."""
        self._latest.clear()
        self._lost, self._is_poor = 0, False
