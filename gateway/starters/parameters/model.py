"""The parameters of one starter at one time, and what two such sets differ in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Annotated

from pydantic import ConfigDict, Field, FiniteFloat
from pydantic.dataclasses import dataclass

from gateway.families import Profile, Variant, decode, parameters, reading

_FORM = ConfigDict(extra="forbid", strict=True)  # of a file as well


@dataclass(frozen=True, slots=True, config=_FORM)
class ParameterEntry:
    """One parameter's value; None where the file or the starter does not give it."""

    name: str = ""
    value: bool | int | FiniteFloat | str | None = None
    label: str | None = None
    unit: str = ""
    raw: Annotated[tuple[Annotated[int, Field(ge=0, le=0xFFFF)], ...], Field(min_length=1)] | None = None

    def __post_init__(self) -> None:
        """Demand something that can be compared; a file may lack it."""
        if self.value is None and self.raw is None:
            raise ValueError("neither value nor raw")

    @property
    def shown(self) -> str:
        """The value for a person, with label and unit."""
        if self.value is None:
            return "raw " + " ".join(map(str, self.raw or ()))
        text = str(self.value).lower() if isinstance(self.value, bool) else str(self.value)
        return f"{text} {self.unit}".rstrip() + (f" ({self.label})" if self.label else "")


@dataclass(frozen=True, slots=True, config=_FORM)
class ParameterSet:
    """What one starter holds, by the manual's code."""

    name: str  # of the starter
    family: str
    taken: str = ""  # RFC 3339
    model: str | None = None
    firmware: str | None = None
    serial: str | None = None
    parameters: Mapping[str, ParameterEntry] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)  # code -> why it could not be read


@dataclass(frozen=True, slots=True)
class Difference:
    """One parameter in which two sets differ; None where one of them does not have it."""

    code: str
    name: str
    before: ParameterEntry | None
    after: ParameterEntry | None

    @property
    def sides(self) -> str:
        """Both values for a person."""
        return " -> ".join("not there" if side is None else side.shown for side in (self.before, self.after))

    @property
    def text(self) -> str:
        """The difference in one line."""
        return f"{self.code} {self.name}: {self.sides}"


def entries_of(
    profile: Profile, variant: Variant, rows: Mapping[str, tuple[int, ...]]
) -> dict[str, ParameterEntry]:
    """Return rows that were read as entries, in the order of the manual; raw-word rows stand last."""
    order = {code: place for place, code in enumerate(profile.parameters)}
    found: dict[str, ParameterEntry] = {}
    for code in sorted(rows, key=lambda each: (order.get(each, len(order)), each)):
        row = parameters.find(profile, code)
        decoded = decode.decode_row(profile, variant, row, rows[code])
        found[code] = ParameterEntry(row.name, decoded.value, decoded.label, decoded.unit, decoded.raw)
    return found


def of_factory(profile: Profile, like: ParameterSet) -> tuple[ParameterSet, ParameterSet]:
    """Return the factory settings that the manual prints, and those rows of a set."""
    entries = entries_of(
        profile, Variant(model=like.model, firmware=like.firmware), parameters.factory_settings(profile)
    )
    held = {code: entry for code, entry in like.parameters.items() if code in entries}
    factory = {code: entry for code, entry in entries.items() if code in held}
    return replace(like, parameters=factory), replace(like, parameters=held)


def differences(
    before: ParameterSet, after: ParameterSet, *, profile: Profile, with_readings: bool = False
) -> tuple[Difference, ...]:
    """Return in which settings two sets of one family differ; `with_readings`: in which of all rows."""
    found = []
    for code in dict.fromkeys((*before.parameters, *after.parameters)):
        row = profile.parameters.get(code)
        one, other = before.parameters.get(code), after.parameters.get(code)
        if row is None:  # of a site, whose configuration is not at hand, or a word without a name
            is_setting = any(parameters.is_named(each.name) for each in (one, other) if each)
        else:
            is_setting = reading.is_setting(profile, row)
        if (with_readings or is_setting) and not _is_same(one, other):
            name = next((each.name for each in (one, other) if each is not None), "")
            found.append(Difference(code, name, one, other))
    return tuple(found)


def _is_same(one: ParameterEntry | None, other: ParameterEntry | None) -> bool:
    if one is None or other is None:
        return False
    if one.raw is not None and other.raw is not None:
        return one.raw == other.raw
    if one.value == other.value:
        return True
    texts = [each.value.casefold() for each in (one, other) if isinstance(each.value, str)]
    labels = [each.label.casefold() for each in (one, other) if each.label is not None]
    return any(text in labels for text in texts)  # an enum given by its label
