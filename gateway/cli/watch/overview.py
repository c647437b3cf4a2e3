"""What gateways publish of their starters, as rows for a table; pure.

A gateway is live while its freshness token changes (`gateway/fresh`, every second): a retained status says
nothing about now. Ages are by that gateway's own clock, so that the clock of this machine does not matter.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from gateway.contract import read_object, shortened

LIVE_WITHIN_S = 12.0  # without a new token for longer, a gateway is not live

CURRENT, CURRENT_PCT = "current", "current_pct"
_FAULT, _OFFLINE = "fault", "offline"
_MOVING = ("starting", "running", "stopping")


class Signal(enum.StrEnum):
    """The four status signals of NAMUR NE 107, and none."""

    FAILURE = "F"
    CHECK = "C"  # someone works at it: locked, local
    OUT_OF_SPEC = "S"
    MAINTENANCE = "M"
    NONE = ""


_ORDER = tuple(Signal)


@dataclass(slots=True)
class ShownValue:
    """A published number with its unit."""

    value: float
    unit: str
    is_good: bool


@dataclass(slots=True)
class GatewayLine:
    """A gateway's status, its token, and the difference of its clock to ours."""

    state: str = "unknown"
    reason: str = ""
    token: str = ""
    live_at_s: float | None = None  # when the token last changed; None: not yet seen to change
    ahead_s: float = 0.0  # of the wall time that the caller gives

    def is_live(self, now_s: float) -> bool:
        """Return whether it has shown a new token lately, and has not ended."""
        is_recent = self.live_at_s is not None and now_s - self.live_at_s <= LIVE_WITHIN_S
        return is_recent and self.state != _OFFLINE


@dataclass(slots=True)
class StarterRow:
    """One starter as last published."""

    gateway: str
    name: str
    availability: str = "unknown"
    state: str = "unknown"
    is_good: bool = False
    reason: str = ""
    time_s: float | None = None  # of the state, since 1970 by the gateway's clock
    readings: dict[str, ShownValue] = field(default_factory=dict)
    alarms: dict[str, tuple[str, str]] = field(default_factory=dict)  # active: code -> severity, text
    is_local: bool = False
    locked_by: str = ""
    command: str = ""  # the last one, in words

    @property
    def signal(self) -> Signal:
        """Return the one status signal that matters most."""
        if self.state == _FAULT or self.availability == _OFFLINE or self._has(_FAULT):
            return Signal.FAILURE
        if self.locked_by or self.is_local or self.availability == "disabled":
            return Signal.CHECK
        if self.availability == "degraded" or not self.is_good or self._has("alarm"):
            return Signal.OUT_OF_SPEC
        return Signal.MAINTENANCE if self.alarms else Signal.NONE

    @property
    def trouble(self) -> str:
        """Return in words what is wrong; empty when nothing is."""
        parts = [
            text if code in text.lower() else f"{code.upper()} {text}"
            for code, (_, text) in sorted(self.alarms.items())
        ]
        if self.availability not in ("online", "unknown") or self.reason:
            word = "" if self.availability in ("online", "unknown") else self.availability
            parts.insert(0, ": ".join(part for part in (word, self.reason) if part))
        if self.locked_by:
            parts.append(f"locked by {self.locked_by}")
        if self.is_local:
            parts.append("local")
        return "; ".join(parts)

    def _has(self, severity: str) -> bool:
        return any(each == severity for each, _ in self.alarms.values())


class Overview:
    """Takes messages in any order and returns rows; a foreign or unreadable message changes nothing.

    `base` may have `+` in place of levels: one table for many gateways.
    """

    def __init__(self, base: str) -> None:
        self.gateways: dict[str, GatewayLine] = {}
        self._depth = base.count("/") + 1
        self._rows: dict[tuple[str, str], StarterRow] = {}

    def take(self, topic: str, payload: bytes, now_s: float) -> None:
        """Apply one message that came at `now_s` (seconds since 1970)."""
        levels = topic.split("/")
        gateway, rest = "/".join(levels[: self._depth]), levels[self._depth :]
        try:
            message = read_object(payload) if payload else {}
            match rest:
                case ["gateway", "status"]:
                    self._take_status(gateway, message)
                case ["gateway", "fresh"]:
                    self._take_token(gateway, message, now_s)
                case ["starter", name, "info" | "state" | "availability"] if not payload:
                    self._rows.pop((gateway, name), None)  # its gateway has it no longer
                case ["starter", name, "availability"]:
                    row = self._row(gateway, name)
                    row.availability = _text(message.get("state")) or "unknown"
                    row.reason = _text(message.get("reason"))
                case ["starter", name, "state"]:
                    _take_state(self._row(gateway, name), message)
                case ["starter", name, "value", point] if point in (CURRENT, CURRENT_PCT):
                    _take_value(self._row(gateway, name), point, message)
                case ["starter", name, "alarm", code]:
                    _take_alarm(self._row(gateway, name), code, message)
                case ["result", name, client] if (gateway, name) in self._rows:
                    self._take_result(self._row(gateway, name), client, message)
        except (ValueError, TypeError):
            return  # whatever else is published below this base is not ours

    def rows(self, only: Callable[[StarterRow], bool] = lambda _: True) -> list[StarterRow]:
        """Return the starters, those first that someone must look at."""
        rows = [row for row in self._rows.values() if only(row)]
        return sorted(rows, key=_order)

    def age_s(self, row: StarterRow, now_s: float) -> float | None:
        """Return how old a starter's state is, by its gateway's clock; None when it was never read."""
        return None if row.time_s is None else max(now_s + self._gateway(row.gateway).ahead_s - row.time_s, 0)

    def is_live(self, row: StarterRow, now_s: float) -> bool:
        """Return whether the gateway of a starter is live."""
        return self._gateway(row.gateway).is_live(now_s)

    def _gateway(self, name: str) -> GatewayLine:
        return self.gateways.setdefault(name, GatewayLine())

    def _row(self, gateway: str, name: str) -> StarterRow:
        return self._rows.setdefault((gateway, name), StarterRow(gateway, name))

    def _take_status(self, name: str, message: Mapping[str, Any]) -> None:
        gateway = self._gateway(name)
        gateway.state = _text(message.get("state")) or "unknown"
        gateway.reason = _text(message.get("reason"))

    def _take_token(self, name: str, message: Mapping[str, Any], now_s: float) -> None:
        gateway, token = self._gateway(name), _text(message.get("token"))
        if gateway.token and token != gateway.token:  # the first may have been retained for days
            gateway.live_at_s = now_s
            gateway.ahead_s = _time_s(message.get("time"), now_s) - now_s
        gateway.token = token

    def _take_result(self, row: StarterRow, client: str, message: Mapping[str, Any]) -> None:
        if message.get("duplicate"):
            return
        phase, code = _text(message.get("phase")), _text(message.get("code"))
        why = "" if code in ("", "ok", phase) else f" ({code})"
        row.command = f"{client} {_text(message.get('verb'))}: {phase}{why}"


def _take_state(row: StarterRow, message: Mapping[str, Any]) -> None:
    row.state = _text(message.get("state")) or "unknown"
    row.is_good = message.get("quality") == "good"
    row.time_s = _time_s(message.get("time"), 0.0) or None
    row.is_local = message.get("remote") is False
    locked = message.get("locked")
    row.locked_by = _text(locked.get("by")) if isinstance(locked, Mapping) else ""


def _take_value(row: StarterRow, point: str, message: Mapping[str, Any]) -> None:
    value = message.get("value")
    if isinstance(value, bool) or not isinstance(value, int | float):
        row.readings.pop(point, None)
        return
    row.readings[point] = ShownValue(value, _text(message.get("unit")), message.get("quality") == "good")


def _take_alarm(row: StarterRow, code: str, message: Mapping[str, Any]) -> None:
    if message.get("active") is True:
        row.alarms[shortened(code)] = _text(message.get("severity")), _text(message.get("text"))
    else:
        row.alarms.pop(shortened(code), None)


def _order(row: StarterRow) -> tuple[int, bool, str, str]:
    signal = row.signal
    rank = len(_ORDER) if signal is Signal.NONE else _ORDER.index(signal)
    return rank, row.state not in _MOVING, row.gateway, row.name


def _text(value: object) -> str:
    """Return a text of somebody else's fit for a terminal."""
    return shortened(value, 80) if isinstance(value, str) else ""


def _time_s(value: object, default: float) -> float:
    if not isinstance(value, str):
        return default
    return datetime.fromisoformat(value).timestamp()
