"""The faults and alarms that one starter has shown: which are active, how often they came, when they went."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from gateway.families.schema import Alarm


@dataclass(frozen=True, slots=True)
class Standing:
    """One alarm as it stands."""

    alarm: Alarm
    is_active: bool
    raised_s: float  # UTC, the last time it came
    cleared_s: float | None  # UTC, None while it is active
    count: int  # how often it came


class AlarmBook:
    """Remembers every alarm that was active once since the gateway's start."""

    def __init__(self) -> None:
        self._standings: dict[str, Standing] = {}

    def update(self, active: Iterable[Alarm], *, time_s: float) -> tuple[Standing, ...]:
        """Take over which alarms are active now, and return those that came or went."""
        by_code = {alarm.code: alarm for alarm in active}
        changed = [
            self._raise(alarm, time_s) for alarm in by_code.values() if not self._is_active(alarm.code)
        ]
        changed += [
            self._clear(standing, time_s)
            for standing in self._standings.values()
            if standing.is_active and standing.alarm.code not in by_code
        ]
        return tuple(changed)

    def active_codes(self, severity: str) -> tuple[str, ...]:
        """Return the codes of this severity that are active, in their order."""
        return tuple(
            sorted(
                s.alarm.code for s in self._standings.values() if s.is_active and s.alarm.severity == severity
            )
        )

    def _is_active(self, code: str) -> bool:
        standing = self._standings.get(code)
        return standing is not None and standing.is_active

    def _raise(self, alarm: Alarm, time_s: float) -> Standing:
        earlier = self._standings.get(alarm.code)
        count = 1 if earlier is None else earlier.count + 1
        standing = Standing(alarm, is_active=True, raised_s=time_s, cleared_s=None, count=count)
        self._standings[alarm.code] = standing
        return standing

    def _clear(self, standing: Standing, time_s: float) -> Standing:
        cleared = replace(standing, is_active=False, cleared_s=time_s)
        self._standings[standing.alarm.code] = cleared
        return cleared
