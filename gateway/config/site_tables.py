"""What a site adds to its families: the tables `[[points]]` and `[[row]]`, and what follows for a starter."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from typing import TYPE_CHECKING, Literal, NamedTuple

from pydantic import Field, ValidationError

from gateway.config.values import ConfigTable, Glob, PointName, RowCode, RowPattern, Text
from gateway.families import FAMILIES, LANGUAGES, Profile, extension, load_profile

if TYPE_CHECKING:
    Family = str
    Language = str
else:
    Family = Literal[FAMILIES]  # whatever profiles there are
    Language = Literal[LANGUAGES]

DEFAULT_EVERY_S = 10.0  # of the points of lines and starters, which have no period of their own
SCALES = (1.0, 0.1, 0.01, 0.001, 0.0001)

Asked = tuple[str, float]  # a code or a pattern, and the period, s


class PointsTable(ConfigTable):
    """`[[points]]`: rows of a family that are published besides its points."""

    family: Family = Field(description="The family whose rows these are.")
    codes: tuple[RowPattern, ...] = Field(
        strict=False,
        min_length=1,
        description="Rows by the manual's codes, with * and ? as in a shell, such as S4.3.*.",
    )
    every_s: float = Field(
        default=DEFAULT_EVERY_S,
        ge=0.1,
        le=3600,
        description="How often they are read; the shortest period of a row counts.",
    )
    starters: tuple[Glob, ...] = Field(
        default=("*",), strict=False, min_length=1, description="Only of these starters of the family."
    )


class RowTable(ConfigTable):
    """`[[row]]`: a row that the family's manual does not describe, from a manual of the site's own."""

    family: Family = Field(description="The family that has it.")
    parameter: RowCode = Field(description="Its code in that manual, such as P102 or C5.3.9.")
    name: PointName = Field(description="The name of its point, where one is asked for.")
    title: Text = Field(description="Its name for people.")
    address: int | None = Field(
        default=None,
        ge=0,
        le=0xFFFF,
        description="Its register, where that is not the number in its code (e.g. ssw900: the net id).",
    )
    type: Literal["u16", "s16", "u32", "s32"] = Field(
        default="u16", description="The number in its registers; 32 bits have the low word first."
    )
    scale: float = Field(
        default=1.0, description="Its value for the number 1: 1, 0.1, 0.01, 0.001 or 0.0001."
    )
    unit: str = Field(default="", max_length=16, description="The unit of its value.")
    min: float | None = Field(
        default=None, ge=-1e10, le=1e10, description="The smallest value to be set, in its unit."
    )
    max: float | None = Field(
        default=None, ge=-1e10, le=1e10, description="The largest value to be set, in its unit."
    )
    writable: bool = Field(default=False, description="Whether it may be set; it needs min and max then.")
    while_: Literal["stopped", "always"] = Field(
        default="stopped", alias="while", description="When it may be set: at standstill only, or always."
    )

    @property
    def profile(self) -> Profile:
        """Return the family's own profile."""
        return load_profile(self.family)

    @property
    def place(self) -> int | None:
        """Return the address of its first register; None where it is missing."""
        return self.address if self.profile.raw_range is None else extension.number_in(self.parameter)

    @property
    def limits(self) -> tuple[int, int] | None:
        """Return the raw numbers between which it may be set; None where they are missing."""
        if self.min is None or self.max is None:
            return None
        scale = Decimal(str(self.scale))
        return int(Decimal(str(self.min)) / scale), int(Decimal(str(self.max)) / scale)

    def described(self) -> extension.SiteRow:
        """Return the row; ValidationError or ValueError where the table contradicts itself."""
        return extension.site_row(
            self.profile,
            self.parameter,
            point=self.name,
            title=self.title,
            address=-1 if self.place is None else self.place,
            kind=self.type,
            decimals=SCALES.index(self.scale),
            unit=self.unit,
            limits=self.limits,
            is_writable=self.writable,
            is_stopped_only=self.while_ == "stopped",
        )


class SiteAdditions(NamedTuple):
    """What is added to the profile of one starter."""

    rows: tuple[extension.SiteRow, ...] = ()
    points: tuple[extension.SitePoint, ...] = ()


def rows_of(family: str, tables: Iterable[RowTable]) -> tuple[extension.SiteRow, ...]:
    """Return the rows that a site describes of a family; a table that contradicts itself gives none."""
    found = []
    for table in tables:
        if table.family == family:
            try:
                row = table.described()
            except (ValidationError, ValueError):
                continue  # it is reported as a mistake
            if not extension.why_not_described(table.profile, row.row):
                found.append(row)
    return tuple(found)


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
