"""How long a starter gets no request while the gateway is restarted, and whether its watchdog outlasts that.

The gap is what had passed since the last request, the end of the process after its lines, and the time from
the start of the next process to the first request to the starter; all computed, for the worst case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from gateway.app.capacity import LineCapacity
from gateway.app.site import Site
from gateway.config import setups_of
from gateway.contract import Event, EventCode, Severity, event_of
from gateway.line import capacity
from gateway.starters import KnownWatchdogs
from gateway.store import STATE_FILE, Documents

STOP_S = 4.0  # from the lines' end to the process's: the farewell may take 3 s


@dataclass(frozen=True, slots=True)
class RestartGap:
    """The longest time without a request to one starter during a restart."""

    starter: str
    gap_s: float
    limit_s: float | None  # of its watchdog; None: off, or not known

    @property
    def wanted_s(self) -> float:
        """Return how long its watchdog must be, with room for retries and chance."""
        return capacity.WIDE_FACTOR * self.gap_s

    def to_dict(self) -> dict[str, Any]:
        """Return it for programs."""
        return {
            "starter": self.starter,
            "gap_s": round(self.gap_s, 3),
            "watchdog_s": self.limit_s,
            "wanted_s": round(self.wanted_s, 3),
            "is_safe": self.is_safe,
        }

    @property
    def is_safe(self) -> bool:
        """Return whether the watchdog outlasts a restart."""
        return self.limit_s is None or self.limit_s >= self.wanted_s


def restart_gaps(
    prospects: Iterable[LineCapacity], *, limit_of: Callable[[str], float | None]
) -> Iterator[RestartGap]:
    """Yield the gap of each enabled starter; `limit_of` returns its watchdog's time by its name."""
    for line in prospects:
        for starter in line.starters:
            name = starter.table.name
            gap_s = starter.gap_s + STOP_S + capacity.START_UP_S + starter.first_poll_s
            yield RestartGap(name, gap_s, limit_of(name))


def announcement(
    reason: str,
    prospects: Iterable[LineCapacity],
    *,
    limit_of: Callable[[str], float | None],
) -> Event:
    """Return the event with which a gateway ends."""
    gaps = list(restart_gaps(prospects, limit_of=limit_of))
    longest = max(gaps, key=lambda gap: gap.gap_s, default=None)
    too_short = [gap.starter for gap in gaps if not gap.is_safe]
    gap_s, starter = (None, None) if longest is None else (round(longest.gap_s, 3), longest.starter)
    if too_short:
        return event_of(
            EventCode.STOPPING,
            "too_long",
            severity=Severity.WARNING,
            reason=reason,
            gap_s=gap_s,
            starter=starter,
            too_short=too_short,
            names=", ".join(too_short),
        )
    return event_of(
        EventCode.STOPPING,
        "no_starter" if longest is None else "restart",
        severity=Severity.INFO,
        reason=reason,
        gap_s=gap_s,
        starter=starter,
        too_short=[],
    )


def planned_gaps(site: Site) -> list[RestartGap]:
    """Return the gaps of a restart with this site, by what its state directory says; NewerError."""
    watchdogs = KnownWatchdogs(Documents(path=site.state_dir / STATE_FILE))
    setups = {setup.name: setup for line in site.config.lines for setup in setups_of(line)}
    limits_s = {name: watchdogs.limit_s(setup) for name, setup in setups.items()}
    return list(restart_gaps(site.prospects, limit_of=limits_s.get))
