"""The record of one start: its summary, and its curve. Their JSON is the same on disk and in MQTT.

A key is present only where its value is known. Currents are in A, voltages in V, times in s relative to the
start, the instant at which the motor began to accelerate.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from typing import Any

from gateway.contract import rfc3339
from gateway.errors import DamagedError

# What a sample may hold, by its key in the record; each is the point of that name, the thermal level that of
# the family's profile.
COLUMNS = ("current", "line_voltage", "output_voltage", "torque_pct", "power_factor", "thermal")
_DIGITS = 4  # significant digits of a sample are fewer


class StartOutcome(enum.StrEnum):
    """How a start ended."""

    FULL_VOLTAGE = "full_voltage"  # also bypass
    TRIPPED = "tripped"
    STOPPED = "stopped"
    GIVEN_UP = "given_up"  # the gateway lost sight of it


class StartSource(enum.StrEnum):
    """Who gave the start."""

    COMMAND = "command"  # one of ours
    LOCAL = "local"  # keypad or inputs, as the starter shows it
    REMOTE = "remote"  # over the serial line or another remote source, and not by us
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Cause:
    """Who gave the start; `client` and `command_id` only of a command of ours."""

    source: StartSource = StartSource.UNKNOWN
    client: str | None = None
    command_id: str | None = None


@dataclass(frozen=True, slots=True)
class QuantityChange:
    """How a quantity of the last starts compares with the baseline."""

    baseline: float
    median: float
    change_pct: float


@dataclass(frozen=True, slots=True)
class StartSummary:
    """Everything about a start but its samples; None is unknown."""

    id: str  # "<boot>-<seq>"
    time_s: float  # of the start, UTC
    boot: str
    seq: int
    outcome: StartOutcome
    cause: Cause = Cause()
    standstill_s: float | None = None  # at rest before, as long as the gateway has seen it
    rate_hz: float | None = None  # samples of the current during the acceleration, by its length
    rated_a: float | None = None
    acceleration_s: float | None = None
    resolution_s: float | None = None  # the acceleration time is known to plus or minus this
    peak_a: float | None = None
    mean_a: float | None = None
    i2t_a2s: float | None = None
    i2t_error_pct: float | None = None  # bound, from the spacing of the samples and both ends' resolution
    lowest_v: float | None = None
    heating_pct: float | None = None  # rise of the thermal level, in its percent
    outliers: int = 0  # readings of the current that cannot be: in none of the values, null in the samples
    is_baseline: bool = False
    drift: Mapping[str, QuantityChange] = field(default_factory=dict)  # by quantity

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of a summary, without what is not known."""
        drift = {name: _change_to_dict(each) for name, each in self.drift.items()}
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        return {
            "id": self.id,
            "time": rfc3339(self.time_s),
            "boot": self.boot,
            "seq": self.seq,
            "cause": {key: value for key, value in asdict(self.cause).items() if value is not None},
            "outcome": self.outcome.value,
            **{name: round(value, _DIGITS) for name, value in numbers.items() if value is not None},
            **({"outliers": self.outliers} if self.outliers else {}),
            "is_baseline": self.is_baseline,
        } | ({"drift": drift} if drift else {})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> StartSummary:
        """Return the summary of a JSON object, with or without samples; DamagedError when it is none."""
        try:
            cause = data["cause"]
            return cls(
                id=str(data["id"]),
                time_s=datetime.fromisoformat(data["time"]).timestamp(),
                boot=str(data["boot"]),
                seq=int(data["seq"]),
                outcome=StartOutcome(data["outcome"]),
                cause=Cause(StartSource(cause["source"]), cause.get("client"), cause.get("command_id")),
                outliers=int(data.get("outliers", 0)),
                is_baseline=bool(data["is_baseline"]),
                drift={str(name): QuantityChange(**each) for name, each in data.get("drift", {}).items()},
                **{name: float(data[name]) for name in _NUMBERS if name in data},
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DamagedError(f"this is no record of a start: {error!r}") from error


# Of a summary, in the order in which they are shown.
_NUMBERS = tuple(each.name for each in fields(StartSummary) if each.type == "float | None")


@dataclass(frozen=True, slots=True)
class StartSamples:
    """The samples of a start: columns as long as `t_s`; None where a reply did not hold that quantity."""

    t_s: tuple[float, ...]
    columns: Mapping[str, tuple[float | None, ...]]  # those of `COLUMNS` of which there is a sample

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of the samples."""
        return {"t_s": list(self.t_s), **{name: list(column) for name, column in self.columns.items()}}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> StartSamples:
        """Return the curve of a JSON object; DamagedError when it is none."""
        try:
            t_s = tuple(float(each) for each in data["t_s"])
            columns = {name: _column(data[name]) for name in COLUMNS if name in data}
        except (KeyError, TypeError, ValueError) as error:
            raise DamagedError(f"these are no samples of a start: {error!r}") from error
        if any(len(column) != len(t_s) for column in columns.values()):
            raise DamagedError("these are no samples of a start: columns of different lengths")
        return cls(t_s, columns)


def start_to_dict(summary: StartSummary, curve: StartSamples) -> dict[str, Any]:
    """Return the JSON object of a whole start."""
    return {**summary.to_dict(), "samples": curve.to_dict()}


def _column(values: Sequence[Any]) -> tuple[float | None, ...]:
    return tuple(None if value is None else float(value) for value in values)


def _change_to_dict(change: QuantityChange) -> dict[str, float]:
    return {
        "baseline": round(change.baseline, _DIGITS),
        "median": round(change.median, _DIGITS),
        "change_pct": round(change.change_pct, 1),
    }
