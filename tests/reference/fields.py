"""Says what a field of a payload is, and converts that to JSON Schema."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Kind = Literal["text", "whole", "number", "flag", "time", "any", "object", "map", "list"]

TYPES: Mapping[Kind, Mapping[str, Any]] = {
    "text": {"type": "string"},
    "whole": {"type": "integer"},
    "number": {"type": "number"},
    "flag": {"type": "boolean"},
    "time": {"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$"},
    "any": {},
    "object": {"type": "object"},
    "map": {"type": "object"},
    "list": {"type": "array"},
}


@dataclass(frozen=True)
class Field:
    """One field: `may_be_null`, `may_be_absent`; `inside`: the fields of an object, a map's value, an item.

    `extra` says what keys an object may have besides, with what `of` describes.
    """

    kind: Kind
    meaning: str
    unit: str = ""
    may_be_null: bool = False
    may_be_absent: bool = False
    values: tuple[str, ...] = ()
    inside: Mapping[str, Field] = field(default_factory=dict)
    extra: str = ""
    of: Kind | None = None  # what plain items of a list, or plain values of a map are

    def to_schema(self, *, is_closed: bool) -> dict[str, Any]:
        """Return the field as JSON Schema (draft 07, as in AsyncAPI)."""
        schema = dict(TYPES[self.kind])
        if self.kind == "object":
            schema |= object_schema(self.inside, extra=self.extra, is_closed=is_closed)
        elif self.kind == "map":
            schema["additionalProperties"] = self._inner(is_closed=is_closed)
        elif self.kind == "list":
            schema["items"] = self._inner(is_closed=is_closed)
        if self.values:
            schema["enum"] = [*map(str, self.values), *([None] if self.may_be_null else [])]
        if self.may_be_null and "type" in schema:
            schema["type"] = [schema["type"], "null"]
        schema["description"] = f"{self.meaning}{f' [{self.unit}]' if self.unit else ''}"
        return schema

    def _inner(self, *, is_closed: bool) -> dict[str, Any]:
        if self.inside:
            inside = object_schema(self.inside, extra=self.extra, is_closed=is_closed)
            return {"type": "object", **inside}
        return dict(TYPES[self.of or "any"])


def object_schema(fields: Mapping[str, Field], *, extra: str = "", is_closed: bool) -> dict[str, Any]:
    """Return an object of these fields. A closed one has no others, unless `extra` says what."""
    properties = {name: each.to_schema(is_closed=is_closed) for name, each in fields.items()}
    schema: dict[str, Any] = {"properties": properties}
    if required := [name for name, each in fields.items() if not each.may_be_absent]:
        schema["required"] = required
    if extra:
        schema["additionalProperties"] = {"description": extra}
    elif is_closed:
        schema["additionalProperties"] = False
    return schema


def text(meaning: str, *, values: Iterable[str] = (), null: bool = False, absent: bool = False) -> Field:
    """Return a field of text."""
    return Field("text", meaning, may_be_null=null, may_be_absent=absent, values=tuple(values))


def whole(meaning: str, unit: str = "", *, null: bool = False, absent: bool = False) -> Field:
    """Return a field of a whole number."""
    return Field("whole", meaning, unit, may_be_null=null, may_be_absent=absent)


def number(meaning: str, unit: str = "", *, null: bool = False, absent: bool = False) -> Field:
    """Return a field of a number, always with a decimal part."""
    return Field("number", meaning, unit, may_be_null=null, may_be_absent=absent)


def flag(meaning: str, *, null: bool = False, absent: bool = False) -> Field:
    """Return a field of true or false."""
    return Field("flag", meaning, may_be_null=null, may_be_absent=absent)


def time(meaning: str, *, null: bool = False, absent: bool = False) -> Field:
    """Return a field of a time, UTC."""
    return Field("time", meaning, may_be_null=null, may_be_absent=absent)


def any_of(meaning: str, *, null: bool = False, absent: bool = False) -> Field:
    """Return a field of any JSON value."""
    return Field("any", meaning, may_be_null=null, may_be_absent=absent)


def group(
    meaning: str,
    inside: Mapping[str, Field],
    *,
    null: bool = False,
    absent: bool = False,
    extra: str = "",
) -> Field:
    """Return a field of an object."""
    return Field("object", meaning, may_be_null=null, may_be_absent=absent, inside=inside, extra=extra)


def mapping(
    meaning: str,
    inside: Mapping[str, Field] | Kind,
    *,
    unit: str = "",
    null: bool = False,
    absent: bool = False,
) -> Field:
    """Return a field of an object whose keys are names or numbers."""
    return _several("map", meaning, inside, unit=unit, null=null, absent=absent)


def several(
    meaning: str, inside: Mapping[str, Field] | Kind, *, null: bool = False, absent: bool = False
) -> Field:
    """Return a field of a list."""
    return _several("list", meaning, inside, null=null, absent=absent)


def _several(
    kind: Kind,
    meaning: str,
    inside: Mapping[str, Field] | Kind,
    *,
    unit: str = "",
    null: bool = False,
    absent: bool = False,
) -> Field:
    is_plain = isinstance(inside, str)
    return Field(
        kind,
        meaning,
        unit,
        may_be_null=null,
        may_be_absent=absent,
        inside={} if is_plain else inside,  # type: ignore[arg-type]
        of=inside if is_plain else None,  # type: ignore[arg-type]
    )
