"""One line as the gateway's health sees it: whether it is full, keeps its watchdogs, and has a good cable.

`Saturation` finds a line without time to spare, `WatchdogAlarm` watchdogs that it does not serve in time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.contract import Event, EventCode, LineRecord, PublishEvent, Severity, event_of
from gateway.line import CableHealth, LineClient, WiredStarter
from gateway.system.rate_limits import HoldOff

QUIET_S = 300.0  # without another, before a starter that was left for too long may be reported again

FULL = 0.95  # of a line's time
RELIEVED = 0.90
FOR_S = 60.0  # before a line counts as full, or as relieved


class WatchedLine:
    """Makes a line's events and its record of its statistics."""

    def __init__(self, line: LineClient, publish_event: PublishEvent) -> None:
        self.line = line
        self._publish_event = publish_event
        self._computed: Mapping[str, Any] = {}
        self._saturation: Saturation | None = None  # of a line that should have time to spare
        self._alarm = WatchdogAlarm(line.name)
        self._cable: CableHealth | None = None

    def reconfigure(self, computed: Mapping[str, Any], wiring: Sequence[WiredStarter] | None) -> None:
        """Judge by these computed worst-case statistics; `wiring`: the starters as the cable passes them."""
        self._computed = computed
        self.line.stop_bound_s = computed.get("stop_latency_s")
        self._saturation = (self._saturation or Saturation()) if computed.get("is_paced") else None
        if wiring is None:
            self._cable = None
        elif self._cable is None:
            self._cable = CableHealth(wiring)
        else:
            self._cable.rewire(wiring)

    def look(self, now_s: float) -> None:
        """Publish when the line is saturated, and when no longer; watchdogs first."""
        statistics = self.line.statistics()
        if "watchdogs" in statistics:
            unkept = self._alarm.take(statistics["watchdogs"], now_s)
            if unkept is not None:
                self._publish_event(unkept)
        if self._saturation is None:
            return
        is_full = self._saturation.take(statistics.get("utilisation", 0.0), now_s)
        if is_full:
            self._publish_event(EventCode.LINE_SATURATED, line=self.line.name, seconds=FOR_S)
        elif is_full is not None:
            self._publish_event(EventCode.LINE_RELIEVED, line=self.line.name)

    def record(self, lag_s: Mapping[str, float], now_s: float) -> LineRecord:
        """Return the line's statistics; publish what has changed in its cable since the last time."""
        data = {**self.line.statistics()}
        if self._cable is not None:
            self._publish_findings(self._cable, data, now_s)
            data["cable"] = self._cable.to_dict()
        if self._computed:
            data["computed"] = self._computed
        return LineRecord(line=self.line.name, data={**data, "lag_s": lag_s})

    def _publish_findings(self, cable: CableHealth, statistics: Mapping[str, Any], now_s: float) -> None:
        changes, line = cable.take(statistics, now_s), self.line.name
        for text in changes.appeared:
            self._publish_event(EventCode.CABLE, "found", severity=Severity.WARNING, line=line, finding=text)
        for text in changes.gone:
            self._publish_event(EventCode.CABLE, "gone", severity=Severity.INFO, line=line, finding=text)


class Saturation:
    """Watches one line's utilisation; a change is reported once it has lasted for a minute."""

    def __init__(self) -> None:
        self._is_full = False
        self._since_s: float | None = None  # when it began to look otherwise

    def take(self, utilisation: float, now_s: float) -> bool | None:
        """Return whether the line is full when that has just changed, None otherwise."""
        is_otherwise = utilisation < RELIEVED if self._is_full else utilisation > FULL
        if not is_otherwise:
            self._since_s = None
            return None
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s < FOR_S:
            return None
        self._is_full, self._since_s = not self._is_full, None
        return self._is_full


class WatchdogAlarm:
    """Watches one line's `watchdogs` statistics; a change is reported once."""

    def __init__(self, line: str) -> None:
        self._line = line
        self._is_full = False  # the watchdogs need more than there is
        self._missed: dict[int, HoldOff] = {}  # by unit

    def take(self, statistics: Mapping[str, float | int], now_s: float) -> Event | None:
        """Return what is wrong when that is news, None otherwise."""
        load, share, unit = statistics["load"], statistics["longest_share"], int(statistics["unit"])
        was_full, self._is_full = self._is_full, load > 1.0
        is_missed = share >= 1.0 and self._missed.setdefault(unit, HoldOff(QUIET_S)).sounds(now_s)
        if self._is_full and not was_full:
            return event_of(EventCode.WATCHDOG_UNKEPT, "overload", line=self._line, load=load)
        if is_missed:
            return event_of(EventCode.WATCHDOG_UNKEPT, "missed", line=self._line, unit=unit, share=share)
        return None
