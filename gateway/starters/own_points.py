"""The points that the gateway itself adds to a starter's: counters and limits; and when they are published.

A value goes out when its quality changes or something discrete does (a start, a trip, a pause that ends),
else when it has changed and `SOONEST_S` have passed, and unchanged after `REFRESH_S`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from gateway.families import Profile, once_per_profile

SOONEST_S = 60.0  # between two publications of a value that grows or falls steadily
REFRESH_S = 300.0

Value = int | float | str | None


@dataclass(frozen=True, slots=True)
class OwnPoint:
    """One of the gateway's own points."""

    name: str
    unit: str
    type: Literal["float", "integer", "string"]
    meaning: str


_POINTS = (
    OwnPoint("hours_total", "h", "float", "operating hours: starting, running, stopping"),
    OwnPoint("hours_low", "h", "float", "operating hours below 50 % of the rated current"),
    OwnPoint("hours_normal", "h", "float", "operating hours at 50 to 90 % of the rated current"),
    OwnPoint("hours_high", "h", "float", "operating hours at 90 to 120 % of the rated current"),
    OwnPoint("hours_over", "h", "float", "operating hours above 120 % of the rated current"),
    OwnPoint("energy_kwh", "kWh", "float", "energy taken by the motor"),
    OwnPoint("starts_total", "", "integer", "starts that the gateway has recorded"),
    OwnPoint("trips_total", "", "integer", "trips seen by the gateway"),
    OwnPoint("trips_by_code", "", "string", "trips seen by the gateway, by fault"),
    OwnPoint("starts_left", "", "integer", "starts that the hour still allows"),
    OwnPoint(
        "pause_left_s", "s", "float", "pause that a start must still wait for, at standstill from now on"
    ),
    OwnPoint("standstill_s", "s", "float", "how long the motor stands still"),
    OwnPoint("restart_in_s", "s", "float", "estimated time until the motor is cool enough for a start"),
)
_FALLING = frozenset({"pause_left_s", "restart_in_s"})  # steadily: if one of them grows, that is news

OWN_POINT_NAMES = frozenset(point.name for point in _POINTS)


@once_per_profile
def own_points(profile: Profile) -> tuple[OwnPoint, ...]:
    """Return the gateway's own points of a family: those that it can know, and the starter has not itself."""
    needs = {
        "energy_kwh": "active_power" in profile.points or bool(profile.history.energy),
        "restart_in_s": bool(profile.history.thermal),
    }
    return tuple(each for each in _POINTS if each.name not in profile.points and needs.get(each.name, True))


class _Published(NamedTuple):
    value: Value
    is_good: bool
    at_s: float


class PublicationPace:
    """Which of the gateway's own points of one starter are to be published now."""

    def __init__(self, points: tuple[OwnPoint, ...]) -> None:
        self._points = points
        self._published: dict[str, _Published] = {}

    def take_due(self, values: Mapping[str, Value], *, is_good: bool, now_s: float) -> tuple[OwnPoint, ...]:
        """Return the points whose value goes out now, and count it as published."""
        due = []
        for point in self._points:
            value = values.get(point.name)
            now = _Published(value, is_good and value is not None, now_s)
            if self._is_due(point, now):
                self._published[point.name] = now
                due.append(point)
        return tuple(due)

    def _is_due(self, point: OwnPoint, now: _Published) -> bool:
        last, value = self._published.get(point.name), now.value
        if last is None or last.is_good is not now.is_good or now.at_s - last.at_s >= REFRESH_S:
            return True
        if value == last.value or not now.is_good:
            return False
        if now.at_s - last.at_s >= SOONEST_S or bool(value) is not bool(last.value):
            return True
        if point.name in _FALLING and isinstance(value, float) and isinstance(last.value, float):
            return value > last.value
        return point.type != "float"  # the others are discrete
