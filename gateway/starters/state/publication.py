"""When something is published of a starter: a function of what was published before and of what is so now.

1. The state goes out at once when it says something else, at the latest after `STATE_EVERY_S`.
2. A value goes out when it differs from the one sent last by more than its deadband, or in its quality; at
   the soonest `SOONEST_S` after that one and at the latest `refresh_s` after it. The newest is sent.
3. To wake up for each value on its own would cost more than to send it: once one must be sent again, those
   that would follow within a tenth of the time go with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf
from typing import NamedTuple

from gateway.starters.state.readings import NO_POINTS, Points, Reading
from gateway.starters.state.starter_state import StarterState, Status

TICK_S = 0.25  # timers run out so much late at most
STATE_EVERY_S = 30.0 - TICK_S
SOONEST_S = 0.25
REFRESH_S = 300.0  # `mqtt.refresh_s` where nothing else is configured
TOGETHER = 0.1

Deadbands = Mapping[str, float]  # by point, in its unit; a missing one is 0


class Sent(NamedTuple):
    """A value as it was sent last."""

    reading: Reading
    at_s: float  # steady clock


class Published(NamedTuple):
    """What was published of a starter until now; times are those of the steady clock."""

    points: Points = NO_POINTS  # that were looked at last
    status: Status | None = None  # as sent last; None: it is to be sent
    reason: str = ""  # sent with it: why nothing is said of a starter
    status_s: float = -inf
    sent: Mapping[str, Sent] = {}
    waiting: tuple[str, ...] = ()  # values that say something else, too soon after the last ones
    soonest_s: float = inf  # when the first of these may be sent
    refresh_at_s: float = -inf  # no value must be sent again before

    @property
    def next_due_s(self) -> float:
        """Return when to look again if nothing happens until then, at times a little early."""
        return min(self.status_s + STATE_EVERY_S, self.soonest_s, self.refresh_at_s)


def due_values(
    before: Published,
    state: StarterState,
    deadbands: Deadbands,
    *,
    now_s: float,
    refresh_s: float = REFRESH_S,
) -> tuple[Published, Points]:
    """Return the values that are to be published now, and what has been published once they are."""
    latest_s = max(refresh_s - TICK_S, SOONEST_S)  # the timer may run out a tick late
    if now_s >= before.refresh_at_s:
        oldest_s = min((last.at_s for last in before.sent.values()), default=inf)
        before = before._replace(refresh_at_s=oldest_s + latest_s)
    is_refreshed = now_s >= before.refresh_at_s
    points, known = state.points, before.points
    old_s = now_s - latest_s * (1 - TOGETHER) if is_refreshed else -inf
    names: Iterable[str] = points
    if before.sent and not is_refreshed:
        changed = [name for name, reading in points.items() if reading is not known.get(name)]
        names = dict.fromkeys((*before.waiting, *changed))
    values: dict[str, Reading] = {}
    waiting: list[str] = []
    sent, soonest_s = dict(before.sent), inf
    for name in names:
        reading, last = points[name], sent.get(name)
        is_due = last is None or last.at_s <= old_s
        if last is not None and not is_due and is_news(last.reading, reading, deadbands.get(name, 0.0)):
            is_due = now_s >= last.at_s + SOONEST_S
            if not is_due:
                waiting.append(name)
                soonest_s = min(soonest_s, last.at_s + SOONEST_S)
        if is_due:
            values[name], sent[name] = reading, Sent(reading, now_s)
    after = before._replace(
        points=points,
        sent=sent if values else before.sent,
        waiting=tuple(waiting),
        soonest_s=soonest_s,
        refresh_at_s=min(before.refresh_at_s, now_s + latest_s) if values else before.refresh_at_s,
    )
    return after, values


def is_news(sent: Reading, now: Reading, deadband: float) -> bool:
    """Return whether a reading differs enough from the one sent last to be published before its time."""
    marks = (sent.quality, sent.label, sent.reason), (now.quality, now.label, now.reason)
    if marks[0] != marks[1] or type(sent.value) is not type(now.value):
        return True
    if isinstance(sent.value, (str, bool)) or sent.value is None or now.value is None:
        return sent.value != now.value
    return abs(float(now.value) - float(sent.value)) > deadband
