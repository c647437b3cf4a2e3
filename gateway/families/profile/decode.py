"""Words into values: of one row, of all points, and of any words for the `decode` command."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from operator import itemgetter
from typing import Any, NamedTuple

from gateway.families.profile.parameters import raw_row, unnamed_code
from gateway.families.profile.rows import OFF, RESERVED, Access, Parameter, Table, Type
from gateway.families.profile.schema import Point, Profile, Variant
from gateway.families.profile.word_types import JOINS, TYPE_LIMITS, from_words, to_percent, to_text

Value = bool | int | float | str | None

NOT_IN_MANUAL = "(not in the manual)"  # of a fault or an alarm that it does not name

WORD_MAX = 0xFFFF
_DIVIDED_FROM_A = 820.0  # ssw06-es 4.4: models of this current and up send whole amperes
_CURRENT = re.compile(r"[A-Za-z]+[- ]?[0-9]+[A-Za-z]*[- ]+([0-9]+(?:[.,][0-9]+)?)")
_VERSION = re.compile(r"([0-9]+)\.([0-9]+)")


class Decoded(NamedTuple):
    """The meaning of words; `value` is None when it cannot be known, `raw` is always there."""

    value: Value
    label: str | None  # of an enum's number; "off"; hh:mm:ss of a time
    unit: str
    raw: tuple[int, ...]


Decoder = Callable[[Sequence[int]], Decoded]  # of as many words as the row has


def decode_row(profile: Profile, variant: Variant, parameter: Parameter, words: Sequence[int]) -> Decoded:
    """Return what a row's words mean, as many as the row has.

    Values with decimals or a unit are floats, counts and enums ints, coils bools, dates and addresses texts.
    A measurement outside the range that the manual prints is not known: 300 °C of a sensor for 260 at most.
    """
    return row_decoder(profile, variant, parameter)(words)


def row_decoder(profile: Profile, variant: Variant, row: Parameter) -> Decoder:
    """Return what decodes a row's words, as `decode_row` does."""
    if row.type not in TYPE_LIMITS:
        return lambda words: Decoded(to_text(row.type, words), label=None, unit="", raw=tuple(words))
    low, high = TYPE_LIMITS[row.type]
    lowest, highest = _possible(row)
    unit = "%" if row.full_scale else row.unit
    is_plain = row.words == 1 and low == 0 and high == WORD_MAX
    number_in = itemgetter(0) if is_plain else partial(from_words, row)
    is_named = row.code in profile.alarm_rows or row.off is not None or row.type is Type.TIME or row.enum
    label_of = partial(_label, profile, row) if is_named else None
    value_of = _value_of(variant, row)

    def decoded(words: Sequence[int]) -> Decoded:
        number, raw = number_in(words), tuple(words)
        if not lowest <= number <= highest:
            return Decoded(None, None, row.unit, raw)
        return Decoded(value_of(number), label_of(number) if label_of else None, unit, raw)

    return decoded


def decode_points(
    profile: Profile, variant: Variant, rows: Mapping[str, tuple[int, ...]]
) -> dict[str, Decoded]:
    """Return the points that these rows (raw words by code) give, by name."""
    found = {
        name: point_decoder(profile, variant, point)(rows[point.code])
        for name, point in profile.points.items()
        if point.code in rows
    }
    for name, point in profile.points.items():
        if point.none_of and all(part in found for part in point.none_of):
            found[name] = _none_of([found[part] for part in point.none_of])
    return found


def decode_words(
    profile: Profile, variant: Variant, table: Table, start: int, words: Sequence[int]
) -> dict[str, dict[str, Any]]:
    """Return what a run of words (bits, for coils) means, ready for JSON: by code, with the point's name.

    Words of no row, or of a row that is not there whole, stand raw under HR, IR or COIL and their number.
    A text over several rows that are all there is added as a whole.
    """
    found: dict[str, dict[str, Any]] = {}
    end = start + len(words)
    address = start
    while address < end:
        rows = [row for row in _rows_at(profile, table, address) if address + row.words <= end]
        offset = address - start
        for row in rows:
            part = words[offset : offset + row.words]
            found[row.code] = _as_json(profile, variant, row, decode_row(profile, variant, row, part))
        if not rows:
            found[unnamed_code(profile, table, address)] = _raw_json(table, words[offset])
        address += max((row.words for row in rows), default=1)
    return found | _joined(profile, variant, found)


def _joined(
    profile: Profile, variant: Variant, found: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return what lies over several of these rows, under the first and the last of them: R22-R29."""
    shown = {}
    for name, join in profile.joins.items():
        if all(code in found for code in join.codes):
            raw = [word for code in join.codes for word in found[code]["raw"]]
            is_known = all(is_there(profile, variant, code) for code in join.codes)
            value = JOINS[join.how](raw, join.begins) if is_known else None
            as_json = {"name": name, "point": name, "value": value, "unit": "", "label": None, "raw": raw}
            shown[f"{join.codes[0]}-{join.codes[-1]}"] = as_json
    return shown


def point_of(profile: Profile, row: Parameter) -> str | None:
    """Return the point that is this row; a WEG coil is a bit of a word (VB01.3) and so may its point be."""
    word, _, bit = row.code.partition(".")
    if row.type is Type.BIT and bit:
        return profile.points_of.get((word, int(bit)))
    return profile.points_of.get((row.code, None))


def since_firmware(profile: Profile, variant: Variant, code: str) -> str:
    """Return the firmware from which this model has a row, or a bit of it (VB01.2); empty: any has it."""
    model = (variant.model or "").casefold()
    by_model = profile.since_firmware.get(code, {}).items()
    return next((since for begins, since in by_model if model.startswith(begins.casefold())), "")


def is_there(profile: Profile, variant: Variant, code: str) -> bool:
    """Return whether this starter has a row, or a bit of it; it does while its firmware is unknown."""
    if code not in profile.since_firmware:  # most of all points, of each reply
        return True
    since = since_firmware(profile, variant, code)
    seen, wanted = _version(variant.firmware or ""), _version(since)
    return seen is None or wanted is None or seen >= wanted


def rated_current_a(model: str) -> float | None:
    """Return the rated current in a model's text ("SSW-06 820.0A", "SSW-07 85A"); None when there is none."""
    current = _CURRENT.search(model)
    value = float(current[1].replace(",", ".")) if current is not None else 0.0
    return value or None


def alarm_code(letter: str, number: int) -> str:
    """Return an alarm's code as the manuals print it, in lower case: e05 (SSW-07), f005, a128 (SSW900)."""
    return f"{letter}{number:0{2 if letter == 'e' else 3}d}"


def _label(profile: Profile, row: Parameter, number: int) -> str | None:
    """Return what a number is called: an enum's member, a coil's meaning, a fault, an alarm, off, a time."""
    letter = profile.alarm_rows.get(row.code)
    if letter is not None:
        code = alarm_code(letter, number)
        text = next((alarm.text for alarm in profile.alarms if alarm.code == code), NOT_IN_MANUAL)
        return f"{code.upper()} {text}" if number else None
    if number == row.off:
        return OFF
    if row.type is Type.TIME:
        minutes, seconds = divmod(number, 60)
        return f"{minutes // 60:02d}:{minutes % 60:02d}:{seconds:02d}"
    return profile.enums[row.enum].get(number) if row.enum else None


def _possible(row: Parameter) -> tuple[int, int]:
    """Return the least and largest number of a row: of its type, of a measurement those that are printed."""
    low, high = TYPE_LIMITS[row.type]
    is_measured = row.access is Access.RO and row.unit and row.is_sure  # (ssw900, table A.2)
    if not is_measured or row.raw_min is None or row.raw_max is None:
        return low, high
    return max(low, row.raw_min), min(high, row.raw_max)


def _value_of(variant: Variant, row: Parameter) -> Callable[[int], Value]:
    """Return what makes a value of a row's number."""
    if row.type is Type.BIT:
        return bool
    if row.full_scale:
        return partial(to_percent, full_scale=row.full_scale)
    divisor = 10 ** (row.decimals or 0)
    if row.is_rated_scaled:
        rated_a = variant.rated_current_a or rated_current_a(variant.model or "")
        if rated_a is None:  # a guess could be wrong by a factor of ten
            return lambda _: None
        return float if rated_a >= _DIVIDED_FROM_A else lambda number: number / divisor
    return (lambda number: number / divisor) if row.decimals or row.unit else int


def point_decoder(profile: Profile, variant: Variant, point: Point) -> Decoder:
    """Return what decodes the words of the row of a point, which is not made of others."""
    row = profile.parameters[point.code]
    if not is_there(profile, variant, point.source):
        return lambda words: Decoded(None, None, "", tuple(words))
    if point.bit is not None or row.type is Type.BIT:
        bit = point.bit or 0
        return lambda words: Decoded(bool(words[0] >> bit & 1), None, "", tuple(words))
    if point.true_when:
        return lambda words: Decoded(from_words(row, words) in point.true_when, None, "", tuple(words))
    decode = row_decoder(profile, variant, row)
    if not point.zero_is_missing:
        return decode

    def decoded(words: Sequence[int]) -> Decoded:
        found = decode(words)
        return found if any(words) else found._replace(value=None, label=None)

    return decoded


def _none_of(parts: Sequence[Decoded]) -> Decoded:
    raw = tuple(word for part in parts for word in part.raw)
    is_open = any(part.value is None for part in parts) and not any(part.value for part in parts)
    value = None if is_open else not any(part.value for part in parts)
    return Decoded(value, label=None, unit="", raw=raw)


def _rows_at(profile: Profile, table: Table, address: int) -> tuple[Parameter, ...]:
    rows = profile.rows_at.get((table, address), ())
    raw = raw_row(profile, address) if not rows and table is Table.HOLDING else None
    return rows if raw is None else (raw,)


def _as_json(profile: Profile, variant: Variant, row: Parameter, decoded: Decoded) -> dict[str, Any]:
    point = point_of(profile, row)
    is_known = is_there(profile, variant, row.code)
    shown: dict[str, Any] = {
        "name": row.name,
        "point": point,
        "value": decoded.value if is_known else None,
        "unit": decoded.unit,
        "label": decoded.label if is_known else None,
        "raw": list(decoded.raw),
    }
    if row.type is Type.BITS:
        shown["bits"] = [
            _bit_json(profile, variant, row.code, bit, is_on=is_on)
            for bit, label in sorted(profile.bits[row.code].items())
            if (is_on := bool(decoded.raw[0] >> bit & 1)) or label != RESERVED
        ]
    return shown


def _bit_json(profile: Profile, variant: Variant, code: str, bit: int, *, is_on: bool) -> dict[str, Any]:
    point = profile.points_of.get((code, bit))
    is_known = is_there(profile, variant, f"{code}.{bit}")
    return {
        "bit": bit,
        "label": profile.bits[code][bit],
        "point": point,
        "value": is_on if is_known else None,
        "meaning": profile.enums.get(f"{code}.{bit}", {}).get(int(is_on)) if is_known else None,
    }


def _raw_json(table: Table, word: int) -> dict[str, Any]:
    value = bool(word) if table.is_bits else word
    return {"name": None, "point": None, "value": value, "unit": "", "label": None, "raw": [word]}


@lru_cache(maxsize=256)  # asked for every point of every reply
def _version(text: str) -> tuple[int, int] | None:
    """Return major and the two digits after the point, so that 1.4 is 1.40."""
    found = _VERSION.search(text)
    return None if found is None else (int(found[1]), int(f"{found[2]}0"[:2]))
