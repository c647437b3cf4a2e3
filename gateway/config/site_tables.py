"""What a site adds to its families: the tables `[[points]]` and `[[row]]`, and what follows for a starter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from decimal import Decimal
from typing import TYPE_CHECKING, Literal, NamedTuple

from pydantic import Field

from gateway.config.mistakes import Mistake
from gateway.config.values import ConfigTable, Glob, PointName, RowCode, RowPattern, Several, Text
from gateway.contract import to_level
from gateway.families import (
    FAMILIES,
    LANGUAGES,
    TYPE_LIMITS,
    Access,
    Confidence,
    Parameter,
    Profile,
    Table,
    Type,
    extension,
    load_profile,
)
from gateway.starters import OWN_POINT_NAMES

if TYPE_CHECKING:
    Family = str
    Language = str
else:
    Family = Literal[FAMILIES]  # whatever profiles there are
    Language = Literal[LANGUAGES]

DEFAULT_EVERY_S = 10.0  # of the points of lines and starters, which have no period of their own
REGISTERS = 65536
SCALES = (1.0, 0.1, 0.01, 0.001, 0.0001)

# What records and other programs name, beside points.
_TAKEN = {"state", "quality", "availability", "reason", "locked", "online", "trouble", "result"}
_TAKEN |= {"start", "stop", "reset", "thermal_load"}

Asked = tuple[str, float]  # a code or a pattern, and the period, s


class PointsTable(ConfigTable):
    """`[[points]]`: rows of a family that are published besides its points."""

    family: Family = Field(description="The family whose rows these are.")
    codes: Several[RowPattern] = Field(min_length=1, description="Rows by code, with * and ?, e.g. S4.*.")
    every_s: float = Field(DEFAULT_EVERY_S, ge=0.1, le=3600, description="How often they are read, at least.")
    starters: Several[Glob] = Field(("*",), min_length=1, description="Only of these starters of the family.")


class RowTable(ConfigTable):
    """`[[row]]`: a row that the family's manual does not describe, from a manual of the site's own."""

    family: Family = Field(description="The family that has it.")
    parameter: RowCode = Field(description="Its code in that manual, such as P102 or C5.3.9.")
    name: PointName = Field(description="The name of its point, where one is asked for.")
    title: Text = Field(description="Its name for people.")
    address: int | None = Field(
        None, ge=0, le=0xFFFF, description="Its register, where its code is no number (e.g. ssw900)."
    )
    type: Literal["u16", "s16", "u32", "s32"] = Field("u16", description="32 bits have the low word first.")
    scale: float = Field(1.0, description="Its value for the number 1: 1, 0.1, 0.01, 0.001 or 0.0001.")
    unit: str = Field("", max_length=16, description="The unit of its value.")
    min: float | None = Field(None, ge=-1e10, le=1e10, description="The smallest value to be set.")
    max: float | None = Field(None, ge=-1e10, le=1e10, description="The largest value to be set.")
    writable: bool = Field(default=False, description="Whether it may be set; it needs min and max then.")
    while_: Literal["stopped", "always"] = Field("stopped", alias="while", description="When it may be set.")

    @property
    def profile(self) -> Profile:
        """Return the family's own profile."""
        return load_profile(self.family)

    @property
    def words(self) -> int:
        """Return how many registers it has."""
        return 2 if self.type.endswith("32") else 1

    @property
    def place(self) -> int | None:
        """Return the address of its first register; None where it is missing."""
        address = self.address  # where it is wrong, so is the row, even if its code says the place
        return address if self.profile.raw_range is None else extension.number_in(self.parameter)

    @property
    def limits(self) -> tuple[int, int] | None:
        """Return the raw numbers between which it may be set; None where they are missing."""
        if self.min is None or self.max is None:
            return None
        scale = Decimal(str(self.scale))
        return int(Decimal(str(self.min)) / scale), int(Decimal(str(self.max)) / scale)

    def contradictions(self) -> Iterator[Mistake]:
        """Yield what first contradicts something else in this row, or in its family."""
        if found := self._contradiction():
            key, what, hint = found
            yield Mistake((key,), what, hint)

    def _contradiction(self) -> tuple[str, str, str] | None:
        profile = self.profile
        if not profile.protected.site:
            return "family", f"the manual of {self.family} describes all its rows", "leave this [[row]] out"
        if self.scale not in SCALES:  # first: `described` divides by it
            return "scale", f"is {self.scale:g}", f"one of {', '.join(f'{each:g}' for each in SCALES)}"
        if self.place is None and profile.raw_range is None:
            return "parameter", "needs address beside it", "its register, as that manual prints it"
        if self.place is None:
            return "parameter", f"{self.parameter!r} is no parameter of {self.family}", "such as P102"
        if self.address is not None and self.address != self.place:
            return "address", f"is {self.address}, and not the number of {self.parameter}", "leave it out"
        if self.place + self.words > REGISTERS:
            return "address", f"{self.place} and the next are no registers", "the last register is 65535"
        if self.limits is None and (self.writable or self.min is not None or self.max is not None):
            missing = "min" if self.min is None else "max"
            return ("writable" if self.writable else "parameter"), f"needs {missing} beside it", "both limits"
        for name, limit in (("min", self.min), ("max", self.max)):
            if limit is not None and Decimal(str(limit)) % Decimal(str(self.scale)):
                return name, f"{limit:g} is no multiple of scale", f"the row has steps of {self.scale:g}"
        if self.limits is not None:
            low, high = self.limits
            lowest, highest = TYPE_LIMITS[Type(self.type)]
            if not lowest <= low <= high <= highest:
                return "max", f"{self.min:g} to {self.max:g} do not fit {self.type}", "another type or limits"
        why = extension.why_not_described(profile, self.described().row)
        if why:
            return "parameter", f"{self.parameter} is not to be described: {why}", "leave this [[row]] out"
        codes = {to_level(code) for code in profile.parameters} - {to_level(self.parameter)}
        points = {name for family in FAMILIES for name in load_profile(family).points}  # rules go by these
        if self.name in codes | points | OWN_POINT_NAMES | _TAKEN:
            return "name", f"{self.name!r} means something else already", "another name"
        return None

    def described(self) -> extension.SiteRow:
        """Return the row as the family's own rows are; a scale by the model, as its manual has it, stays."""
        known = self.profile.parameters.get(self.parameter)
        low, high = self.limits or (None, None)
        row = Parameter(
            code=self.parameter,
            name=self.title,
            table=Table.HOLDING,
            address=self.place or 0,
            words=self.words,
            type=Type(self.type),
            decimals=SCALES.index(self.scale),
            unit=self.unit,
            raw_min=low,
            raw_max=high,
            access=Access.RW if self.writable else Access.RO,
            confidence=Confidence.SITE,
            is_stopped_only=self.while_ == "stopped",
            is_rated_scaled=known is not None and known.is_rated_scaled,
            source="the site's configuration",
        )
        return extension.SiteRow(row=row, point=self.name)


class SiteAdditions(NamedTuple):
    """What is added to the profile of one starter."""

    rows: tuple[extension.SiteRow, ...] = ()
    points: tuple[extension.SitePoint, ...] = ()


def rows_of(family: str, tables: Iterable[RowTable]) -> tuple[extension.SiteRow, ...]:
    """Return the rows that a site describes of a family."""
    return tuple(table.described() for table in tables if table.family == family)


def additions(family: str, tables: Iterable[RowTable], asked: Iterable[Asked]) -> SiteAdditions:
    """Return what is added to a starter of a family; codes that its rows do not fit ask for nothing."""
    rows = rows_of(family, tables)
    wider = extension.extended(load_profile(family), rows, ())
    periods: dict[str, float] = {}
    for pattern, every_s in asked:
        for code in extension.matching(wider, pattern):
            periods[code] = min(every_s, periods.get(code, every_s))
    points = (extension.SitePoint(code=code, every_s=periods[code]) for code in sorted(periods))
    return SiteAdditions(rows, tuple(points))
