"""How much of a full line's time jobs may take from the polls that are due meanwhile."""

from __future__ import annotations

from math import inf

from gateway.line.job import Lane

JOBS_SHARE = 0.5  # of the line's time, for all jobs but stops
JOBS_SAVED_S = (
    0.5  # of line time can be saved up: a start with its read-backs needs about a third of a second
)
PARAMETERS_SHARE = 0.25  # for reads and settings of parameters alone, of the same time
PARAMETERS_SAVED_S = 0.1  # a few transactions


class Share:
    """A bucket of line time that fills by a share; what is used while nobody else wants the line is owed too.

    No more is owed than can be saved up, so that a quiet night on the line costs nobody the morning.
    """

    def __init__(self, share: float, saved_s: float) -> None:
        self._share = share
        self._ahead_s = saved_s / share  # so long before it is paid for, it may be used
        self._paid_s = -inf  # when everything used so far is paid for

    def has_room(self, now_s: float) -> bool:
        """Return whether there is something left of what was saved up."""
        return self._paid_s - now_s < self._ahead_s

    def spend(self, took_s: float, now_s: float) -> None:
        """Take over that so much of the line was used until now."""
        paid_s = max(self._paid_s, now_s) + took_s / self._share
        self._paid_s = min(paid_s, now_s + 2 * self._ahead_s)


class Shares:
    """Which jobs may go before a poll that is due; stops, their repeats and read-backs always may."""

    def __init__(self) -> None:
        self._jobs = Share(JOBS_SHARE, JOBS_SAVED_S)
        self._parameters = Share(PARAMETERS_SHARE, PARAMETERS_SAVED_S)

    def last_lane(self, now_s: float) -> Lane:
        """Return the last of the lanes that may."""
        if not self._jobs.has_room(now_s):
            return Lane.FOLLOW_UP
        return Lane.PARAMETERS if self._parameters.has_room(now_s) else Lane.READ_BACK

    def spend(self, lane: Lane, took_s: float, now_s: float) -> None:
        """Take over what a job has used of the line."""
        if lane > Lane.FOLLOW_UP:
            self._jobs.spend(took_s, now_s)
        if lane is Lane.PARAMETERS:
            self._parameters.spend(took_s, now_s)
