"""A start or a trip as a recording of channels over time, and that as CSV or as COMTRADE.

COMTRADE is IEC 60255-24:2013 (IEEE C37.111-2013): an ASCII `.cfg` and `.dat`. What the starters give is no
oscillography: moments are not evenly spaced, so the number of sampling rates is 0 and the time stamps of the
`.dat` count. Flags are status channels, all else is analog. A channel that was not read at a moment has the
value read last, as a status that stands; before its first reading it has that one.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from gateway.contract import rfc3339

UNITS = {  # of a start's samples, whose points are those of the contract
    "current": "A",
    "current_pct": "%",
    "line_voltage": "V",
    "output_voltage": "V",
    "torque_pct": "%",
    "thermal": "%",
    "active_power": "kW",
}

REVISION = "2013"
LINE_END = "\r\n"
MOST = 99998  # of an ASCII sample; 99999 stands for a missing one
MICROSECONDS = 1e6  # time stamps are in microseconds, times 1
UNKNOWN_TIME = datetime(1970, 1, 1, tzinfo=UTC)
LONGEST_NAME = 64  # characters of an identifier


@dataclass(frozen=True, slots=True)
class Channel:
    """One quantity or flag; `values` has one for each moment, None where it was not read then."""

    name: str
    unit: str
    values: tuple[float | bool | None, ...]

    @property
    def is_flag(self) -> bool:
        """Return whether it is on or off."""
        return any(isinstance(value, bool) for value in self.values)

    def held(self) -> tuple[float | bool, ...]:
        """Return the values, each gap filled by what was read last, at the beginning by what comes first."""
        first = next((value for value in self.values if value is not None), 0.0)
        filled, last = [], first
        for value in self.values:
            last = last if value is None else value
            filled.append(last)
        return tuple(filled)


@dataclass(frozen=True, slots=True)
class Recording:
    """Channels over time; `moment` is the trip or the start, to which `t_s` is relative."""

    starter: str
    kind: str  # trip or start
    id: str
    moment: datetime | None  # UTC
    t_s: tuple[float, ...]
    channels: tuple[Channel, ...]


def recording_of(starter: str, data: Mapping[str, Any], *, units: Mapping[str, str]) -> Recording:
    """Return what the JSON of a start or of a trip holds; ValueError where it holds no readings.

    `units` are those of the starter's points.
    """
    kind = "trip" if "readings" in data else "start"
    table = data["readings"] if kind == "trip" else data.get("samples", {})
    t_s = tuple(table.get("t_s", ()))
    columns = table["points"] if kind == "trip" else {n: v for n, v in table.items() if n != "t_s"}
    columns = {**columns, **{n: [v] * len(t_s) for n, v in table.get("constant", {}).items()}}
    if not t_s or not columns:
        raise ValueError(f"the {kind} {data['id']} holds no readings")
    channels = tuple(
        Channel(name, units.get(name) or UNITS.get(name, ""), tuple(column))
        for name, column in sorted(columns.items())
    )
    moment = None if data["time"] is None else datetime.fromisoformat(data["time"])
    return Recording(starter, kind, data["id"], moment, t_s, channels)


def to_csv(recording: Recording) -> str:
    """Return a table: seconds from the moment, UTC where it is known, a column a channel; RFC 4180.

    A flag is 0 or 1. A field is empty where nothing was read, or nothing else than before and after it.
    """
    out = io.StringIO()
    writer = csv.writer(out)
    names = [f"{each.name} [{each.unit}]" if each.unit else each.name for each in recording.channels]
    writer.writerow(["t_s", "time", *names])
    for row, t_s in enumerate(recording.t_s):
        time = None if recording.moment is None else rfc3339(recording.moment.timestamp() + t_s)
        writer.writerow([t_s, time, *(_cell(channel.values[row]) for channel in recording.channels)])
    return out.getvalue()


def _cell(value: float | bool | None) -> Any:  # noqa: FBT001 - a reading
    return int(value) if isinstance(value, bool) else value


def to_comtrade(recording: Recording) -> tuple[str, str]:
    """Return the texts of the `.cfg` and of the `.dat`."""
    analog = [channel for channel in recording.channels if not channel.is_flag]
    status = [channel for channel in recording.channels if channel.is_flag]
    scales = [_scale(channel.held()) for channel in analog]
    return _cfg(recording, analog, scales, status), _dat(recording, analog, scales, status)


def _cfg(
    recording: Recording, analog: Sequence[Channel], scales: Sequence[float], status: Sequence[Channel]
) -> str:
    trigger = recording.moment or UNKNOWN_TIME
    first = trigger + timedelta(seconds=recording.t_s[0])
    lines = [
        f"{_name(recording.starter)},{_name(f'{recording.kind} {recording.id}')},{REVISION}",
        f"{len(analog) + len(status)},{len(analog)}A,{len(status)}D",
    ]
    for number, (channel, scale) in enumerate(zip(analog, scales, strict=True), 1):
        samples = _samples(channel, scale)
        lines.append(
            f"{number},{_name(channel.name)},,,{_name(channel.unit)},{scale!r},0,0,"
            f"{min(samples)},{max(samples)},1,1,P"
        )
    for number, channel in enumerate(status, 1):
        lines.append(f"{number},{_name(channel.name)},,,0")
    lines += [f"{_nominal_hz(recording):g}", "0", f"0,{len(recording.t_s)}"]
    lines += [_time(first), _time(trigger), "ASCII", "1", "0,0", "F,3"]  # UTC; the quality is not known: F
    return LINE_END.join(lines) + LINE_END


def _dat(
    recording: Recording, analog: Sequence[Channel], scales: Sequence[float], status: Sequence[Channel]
) -> str:
    columns: list[Sequence[int]] = [_samples(each, s) for each, s in zip(analog, scales, strict=True)]
    columns += [[int(value) for value in channel.held()] for channel in status]
    lines = []
    for row, t_s in enumerate(recording.t_s):
        stamp = round((t_s - recording.t_s[0]) * MICROSECONDS)
        lines.append(",".join(map(str, (row + 1, stamp, *(column[row] for column in columns)))))
    return LINE_END.join(lines) + LINE_END


def _samples(channel: Channel, scale: float) -> list[int]:
    return [round(value / scale) for value in channel.held()]


def _scale(values: Sequence[float]) -> float:
    """Return the step of a channel: the least power of ten, from 0.001 on, with which all values fit."""
    most = max(abs(value) for value in values)
    exponent = -3 if most == 0 else max(-3, math.ceil(math.log10(most / MOST)))
    return float(f"1e{exponent}")


def _nominal_hz(recording: Recording) -> float:
    """Return the nominal frequency that is nearest to what was read; 50 Hz where it was not."""
    read_hz = [max(each.held()) for each in recording.channels if each.name == "line_frequency"]
    return 60.0 if read_hz and read_hz[0] > (50.0 + 60.0) / 2 else 50.0


def _time(moment: datetime) -> str:
    return moment.strftime("%d/%m/%Y,%H:%M:%S.%f")


def _name(text: str) -> str:
    """Return a text without what would end a field."""
    return "".join(sign if sign.isprintable() and sign != "," else " " for sign in text)[:LONGEST_NAME]
