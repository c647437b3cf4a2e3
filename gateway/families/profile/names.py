"""Names and meanings: points and rows in words, and names in another language."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gateway.families.profile.rows import Type
from gateway.families.profile.schema import Point, Profile, remade

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


def translated(profile: Profile, rows: Iterable[Mapping[str, str]]) -> Profile:
    """Return the profile with the names of a language; codes and keys stay.

    A name has the `code` of a row, a fault or an alarm, and `text`; with a `number` it is that of an enum's
    value, or of 0 and 1 of a bit (VB01.8). KeyError where it names nothing.
    """
    parameters, alarms = dict(profile.parameters), {each.code: each for each in profile.alarms}
    enums = {code: dict(labels) for code, labels in profile.enums.items()}
    for row in rows:
        code, text = row["code"], row["text"]
        if "number" in row:
            enums[code][int(row["number"])] = text
        elif code in parameters:
            parameters[code] = parameters[code].model_copy(update={"name": text})
        else:
            alarms[code] = alarms[code].model_copy(update={"text": text})
    return remade(
        profile,
        parameters=parameters,
        alarms=tuple(alarms.values()),
        enums=enums,
        english_enums=profile.enums if enums != profile.enums else {},
    )


def _labels(profile: Profile, point: Point) -> dict[int, str]:
    key = f"{point.code}.{point.bit}" if point.bit is not None else profile.parameters[point.code].enum
    return profile.enums.get(key, {})
