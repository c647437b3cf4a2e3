"""Names and meanings: points and rows in words, and names in another language."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gateway.families.profile.rows import Model, Type
from gateway.families.profile.schema import Point, Profile

MEANINGS = {  # of the quantities that families share; what a bit means is the manual's own text
    "current": "mean current of the motor's phases",
    "current_pct": "mean current, 100 % = the motor's rated current",
    "line_voltage": "mean voltage of the supply, phase to phase",
    "output_voltage": "mean voltage on the motor, phase to phase",
    "line_frequency": "frequency of the supply",
    "power_factor": "power factor at the starter's output",
    "active_power": "active power at the starter's output",
    "apparent_power": "apparent power at the starter's output",
    "reactive_power": "reactive power at the starter's output",
    "torque_pct": "torque of the motor, 100 % = its rated torque",
    "heatsink_temperature": "temperature of the power semiconductors' heatsink",
    "fault_code": "number of the fault; while `fault` is false that of the last one, or 0",
    "starts_total": "number of starts since the starter was made or its counters were reset",
}


class Translation(Model):
    """A line of a language's table: the name of a row, a fault or an alarm, or what a number means."""

    code: str
    number: int | None = None  # of a value, or 0 and 1 of a bit (VB01.8)
    text: str
    source: str = ""


def printed_name(profile: Profile, name: str) -> str:
    """Return what the manual calls a point: its row, or the bit of it."""
    point = profile.points[name]
    if point.none_of:
        return ", ".join(printed_name(profile, each) for each in point.none_of)
    if point.bit is not None:
        return profile.bits[point.code][point.bit]
    return profile.parameters[point.code].name


def meaning_of(profile: Profile, name: str) -> str:
    """Return what a point's value says: what false and true mean, or what is measured."""
    point = profile.points[name]
    if point.none_of:
        return f"true: neither {' nor '.join(point.none_of)}"
    labels = _labels(profile, point)
    if point.true_when:
        return "true: " + ", ".join(labels.get(each, str(each)) for each in point.true_when)
    if point.bit is not None or profile.parameters[point.code].type is Type.BIT:
        said = [f"{word}: {labels[value]}" for value, word in enumerate(("false", "true")) if value in labels]
        return "; ".join(said) or f"true: {printed_name(profile, name)}"
    return point.meaning or MEANINGS.get(name) or printed_name(profile, name)


def translated(profile: Profile, rows: Iterable[tuple[str, Translation]], problems: list[str]) -> Profile:
    """Return the profile with the names of a language; codes and keys stay.

    Each row comes with where it stands; those that name nothing are added to `problems`.
    """
    parameters, alarms = dict(profile.parameters), {each.code: each for each in profile.alarms}
    enums = {code: dict(labels) for code, labels in profile.enums.items()}
    for where, row in rows:
        name: dict[str, Any] = {"name": row.text}
        if row.number is not None and row.number in enums.get(row.code, {}):
            enums[row.code][row.number] = row.text
        elif row.number is None and row.code in parameters:
            parameters[row.code] = parameters[row.code].model_copy(update=name)
        elif row.number is None and row.code in alarms:
            alarms[row.code] = alarms[row.code].model_copy(update={"text": row.text})
        else:
            number = "" if row.number is None else f" {row.number}"
            problems.append(f"{where}: {row.code}{number} is nothing that has a name")
    named = {"parameters": parameters, "alarms": tuple(alarms.values()), "enums": enums}
    named["english_enums"] = profile.enums if enums != profile.enums else {}
    others = {field: getattr(profile, field) for field in Profile.model_fields if field not in named}
    return Profile.model_validate(
        {**others, **named}
    )  # a new profile: the caches of the old one name its rows


def _labels(profile: Profile, point: Point) -> dict[int, str]:
    key = f"{point.code}.{point.bit}" if point.bit is not None else profile.parameters[point.code].enum
    return profile.enums.get(key, {})
