"""Whether a line keeps its starters from their communication watchdogs; those found at run time, too."""

from __future__ import annotations

from collections.abc import Mapping

QUIET_S = 300.0  # without another, before a starter that was left for too long may be told of again


class WatchdogAlarm:
    """Watches one line's `watchdogs` figures; what has changed is told once."""

    def __init__(self) -> None:
        self._is_full = False  # the watchdogs need more than there is
        self._missed: dict[int, float] = {}  # by unit: when one was last left for too long

    def take(self, figures: Mapping[str, float | int], now_s: float) -> str | None:
        """Return what is wrong when that is news, None otherwise."""
        load, share, unit = figures["load"], figures["longest_share"], int(figures["unit"])
        was_full, self._is_full = self._is_full, load > 1.0
        told = None
        if self._is_full and not was_full:
            told = f"the starters' watchdogs need {load:.0%} of its time and cannot all be kept"
        if share >= 1.0:
            if now_s - self._missed.get(unit, -QUIET_S) >= QUIET_S and told is None:
                told = f"address {unit} was left for {share:.0%} of its watchdog's time: it may have acted"
            self._missed[unit] = now_s
        return told
