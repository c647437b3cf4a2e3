"""How early a wait must be woken on this machine, so that it ends on time."""

from __future__ import annotations

FIRST_S, LEAST_S, MOST_S = 0.0001, 0.00005, 0.0004

_EARLIER_S, _LATER_S = 0.000012, 0.000003  # the steps of learning: one write in five then is late


class Lead:
    """Learns from each write that follows a wait."""

    def __init__(self) -> None:
        self.seconds = FIRST_S

    def learn(self, left_s: float) -> None:
        """Take over how much time was left when all was ready, negative when it was too late."""
        if left_s < 0.0:
            self.seconds = min(self.seconds + _EARLIER_S, MOST_S)
        else:
            self.seconds = max(self.seconds - _LATER_S, LEAST_S)
