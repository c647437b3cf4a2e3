"""How early a wait must be woken on this machine, so that it ends on time."""

from __future__ import annotations

FIRST_S, LEAST_S, MOST_S = 0.0001, 0.00005, 0.0003
JUST_IN_TIME_S = 0.00003  # left after waking up: as long as it takes to get to the write

_EARLIER_S, _LATER_S = 0.000012, 0.000003  # the steps of learning: one in five then is later than that


class Lead:
    """Learns from each wait that was woken."""

    def __init__(self) -> None:
        self.seconds = FIRST_S

    def learn(self, left_s: float) -> None:
        """Take over how much time was left, negative when it was too late."""
        if left_s < JUST_IN_TIME_S:
            self.seconds = min(self.seconds + _EARLIER_S, MOST_S)
        else:
            self.seconds = max(self.seconds - _LATER_S, LEAST_S)
