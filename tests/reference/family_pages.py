"""The generated half of docs/families."""

from __future__ import annotations

from gateway.families.profile.load import ENGLISH, LANGUAGES, load_profile
from gateway.families.profile.names import meaning_of
from gateway.families.profile.rows import RESERVED, Parameter
from gateway.families.profile.schema import Point, Profile, Write
from tests.reference.markdown import table


def tables(family: str) -> str:
    """Return all that a family's profile says, as Markdown."""
    profile = load_profile(family)
    sections = (_limits, _points, _commands, _alarms, _parameters, _values, _bits)
    return "\n".join(section(profile) for section in sections)


def _limits(profile: Profile) -> str:
    timing, limits = profile.timing, profile.limits
    stated = "" if timing.is_stated else " (ours: the manual does not say)"
    rows = [
        ("rates", ", ".join(map(str, profile.bauds)) or "not stated"),
        ("byte formats", ", ".join(profile.framings)),
        ("functions", ", ".join(map(str, limits.functions))),
        ("longest response time", f"{timing.read_s * 1000:g} ms{stated}"),
        ("per register written with FC16", f"{timing.write_per_register_s * 1000:g} ms"),
        ("registers a read, a write", f"{limits.read_registers}, {limits.write_registers}"),
        ("longest frame", f"{limits.frame_bytes} bytes"),
    ]
    return table("## Limits", ("", ""), rows)


def _points(profile: Profile) -> str:
    rows = []
    for name, point in profile.points.items():
        row = profile.parameters.get(point.code)
        unit = row.unit if row and point.bit is None else ""
        rows.append((f"`{name}`", _source(point), unit, point.group, meaning_of(profile, name)))
    return table("## Points", ("point", "read from", "unit", "group", "meaning"), rows)


def _source(point: Point) -> str:
    if point.none_of:
        return "none of " + ", ".join(point.none_of)
    source = point.code + (f" bit {point.bit}" if point.bit is not None else "")
    return source + (f" in {', '.join(map(str, point.true_when))}" if point.true_when else "")


def _commands(profile: Profile) -> str:
    rows = [
        (
            f"`{verb}`",
            ", ".join(command.args) or "-",
            ", ".join(map(_write, command.writes)) or "-",
            ", ".join([*command.requires, *(f"{code} set to serial" for code in command.needs)]) or "-",
            command.verify.point if command.verify else "-",
        )
        for verb, command in profile.commands.items()
    ]
    return table("## Commands", ("command", "args", "writes", "requires", "read back"), rows)


def _write(write: Write) -> str:
    if write.coil is not None:
        return f"coil {write.coil} = {int(write.value)}"
    bits = [f"{bits:04X}h to {value}" for bits, value in ((write.set_bits, 1), (write.clear_bits, 0)) if bits]
    mask = " with its mask" if write.mask_shift is not None else ""
    return f"{write.word}: {' and '.join(bits)}{mask}"


def _alarms(profile: Profile) -> str:
    named = {
        language: {each.code: each.text for each in load_profile(profile.family, language).alarms}
        for language in LANGUAGES
    }
    others = {language: names for language, names in named.items() if names != named[ENGLISH]}
    return table(
        "## Faults and alarms",
        ("code", "kind", "name", "section", *(f"in {language}" for language in others)),
        [
            (
                f"`{alarm.code}`",
                alarm.severity,
                alarm.text,
                alarm.source if alarm.confidence == "manual" else f"{alarm.source} ({alarm.confidence})",
                *(names[alarm.code] for names in others.values()),
            )
            for alarm in profile.alarms
        ],
    )


def _parameters(profile: Profile) -> str:
    rows = [
        (
            row.code,
            row.name,
            str(row.address),
            str(row.type),
            "" if row.decimals is None else str(row.decimals),
            row.unit,
            _range(row),
            _access(row),
        )
        for row in profile.parameters.values()
    ]
    head = ("code", "name", "address", "type", "decimals", "unit", "raw range", "access")
    return table("## Parameters", head, rows)


def _values(profile: Profile) -> str:
    rows = [
        (row.code, ", ".join(f"{number} {label}" for number, label in profile.enums[row.enum].items()))
        for row in profile.parameters.values()
        if row.enum
    ]
    return table("## Values", ("code", "numbers and what they mean"), rows)


def _bits(profile: Profile) -> str:
    rows = []
    for code, labels in profile.bits.items():
        for bit, label in sorted(labels.items()):
            meanings = profile.enums.get(f"{code}.{bit}", {})
            if label != RESERVED:
                rows.append((code, str(bit), label, meanings.get(0, ""), meanings.get(1, "")))
    return table("## Bits", ("code", "bit", "name", "0", "1"), rows) if rows else ""


def _range(row: Parameter) -> str:
    return "" if row.raw_min is None else f"{row.raw_min}..{row.raw_max}"


def _access(row: Parameter) -> str:
    writable = (
        "read, set" if row.is_writable else {"command": "by verbs", "none": "-"}.get(row.access, "read")
    )
    return writable if row.confidence == "manual" else f"{writable} ({row.confidence})"
