"""The requests that an SSW900's registers accept (ssw900 7.2, 7.3)."""

from __future__ import annotations

from collections.abc import Sequence

from gateway.families import Parameter
from gateway.sim.core.registers import Registers, is_writable
from gateway.sim.core.requests import refuse_address

LONGEST_STRICT = 2  # requests of more registers pass over what does not exist or cannot be written (7.3)


def check_read(table: Registers, registers: range) -> None:
    """Raise what answers a read of these registers, if it is refused (7.3)."""
    for register in registers if len(registers) <= LONGEST_STRICT else ():
        if register not in table.owners:
            raise refuse_address(register)
    _check_whole(table, registers)


def writes(table: Registers, address: int, words: Sequence[int]) -> list[tuple[Parameter, Sequence[int]]]:
    """Return what a write changes; raise what answers it, if it is refused (7.3, 7.4)."""
    registers = range(address, address + len(words))
    rows = {row.address: row for register in registers if (row := table.owners.get(register))}
    for register in registers if len(registers) <= LONGEST_STRICT else ():
        row = table.owners.get(register)
        if row is None or not is_writable(row):
            raise refuse_address(register)
    _check_whole(table, registers)
    changes = [
        (row, words[at - address : at - address + row.words]) for at, row in rows.items() if is_writable(row)
    ]
    for row, its_words in changes:
        table.check(row, its_words)
    return changes


def _check_whole(table: Registers, registers: range) -> None:
    """Refuse a part of a longer type, in requests of any length (7.3; erratum D-04)."""
    for register in (registers[0], registers[-1]):
        row = table.owners.get(register)
        if row is not None and not (row.address in registers and row.address + row.words - 1 in registers):
            raise refuse_address(register)
