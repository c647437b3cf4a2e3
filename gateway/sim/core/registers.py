"""The registers of a simulated starter as its family's profile has them: which there are, and what they hold.

Addresses, types, decimals, limits, reserved members and factory settings are the profile's; a family adds
what it measures, by the manual's codes, and how it refuses what is not there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gateway.families import (
    RESERVED,
    TYPE_LIMITS,
    Access,
    Parameter,
    Profile,
    Table,
    Variant,
    from_words,
    parameters,
)
from gateway.sim.core.requests import refuse_value

Measured = Mapping[str, float | tuple[int, ...]]  # in the row's unit, or raw words, by code


class Registers:
    """One table of a family."""

    def __init__(self, profile: Profile, table: Table, *, variant: Variant | None = None) -> None:
        self.profile = profile
        self.owners: dict[int, Parameter] = {}  # the row that fills a register
        self.words: dict[int, int] = {}  # as people have set them; 0 of what is measured
        self.fixed: dict[int, int] = {}  # registers that a test nails down
        self._variant = variant or Variant()
        for row in profile.parameters.values():
            if row.table is not table or row.access is Access.NONE:
                continue
            if row.address not in self.owners or is_writable(row):  # else another name for the same register
                self.owners.update(dict.fromkeys(_span(row), row))
        self.deliver()

    def deliver(self) -> None:
        """Take up the factory settings, as far as they are printed; else the lowest value."""
        factory = parameters.factory_settings(self.profile)
        for row in self.rows():
            lowest = self._limits(row)[0] or 0
            self.hold(row, factory.get(row.code) or _split(row, max(lowest, 0) if is_writable(row) else 0))

    def rows(self) -> list[Parameter]:
        """Return the rows, each once."""
        return list({row.address: row for row in self.owners.values()}.values())

    def word(self, register: int, measured: Measured) -> int:
        """Return what a register reads; KeyError where there is none."""
        if register in self.fixed:
            return self.fixed[register]
        held, row = self.words[register], self.owners.get(register)
        value = measured.get(row.code) if row is not None else None
        if row is None or value is None:
            return held
        words = value if isinstance(value, tuple) else _split(row, self._raw(row, value))
        return words[register - row.address]

    def check(self, row: Parameter, words: Sequence[int]) -> None:
        """Raise what answers a value out of range, or a reserved one (exception 3)."""
        lowest, highest = self._limits(row)
        if lowest is None or highest is None:
            return
        value, members = from_words(row, words), self.profile.enums.get(row.enum)
        is_reserved = members is not None and members.get(value, RESERVED) == RESERVED
        if is_reserved or not lowest <= value <= highest:
            raise refuse_value(f"{row.code}: {value} is not in {lowest}..{highest}, or reserved")

    def hold(self, row: Parameter, words: Sequence[int]) -> None:
        """Hold these words from now on."""
        self.words.update(zip(_span(row), words, strict=True))

    def _limits(self, row: Parameter) -> tuple[int | None, int | None]:
        return parameters.raw_limits(row, self._variant) or (row.raw_min, row.raw_max)

    def _raw(self, row: Parameter, value: float) -> int:
        """Return the number that is sent for a value, cut to what the type carries."""
        lowest, highest = TYPE_LIMITS[row.type]
        return max(lowest, min(highest, round(value * 10.0 ** (row.decimals or 0))))


def is_writable(row: Parameter) -> bool:
    """Return whether the manual lets the row be written, by a setting or a command."""
    return row.access in (Access.RW, Access.COMMAND)


def _span(row: Parameter) -> range:
    return range(row.address, row.address + row.words)


def _split(row: Parameter, number: int) -> tuple[int, ...]:
    """Return the words of a number, the low one first; of a low-byte type the byte alone."""
    mask = min(TYPE_LIMITS.get(row.type, (0, 0xFFFF))[1] | 0xFF, 0xFFFF)
    return tuple(number >> 16 * place & mask for place in range(row.words))
