"""Which registers an SSW900 has, and what a request may ask of them (ssw900 7.2, 7.3, table A.2)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gateway.families import Access, Parameter, Type
from gateway.sim.core.requests import refuse_address, refuse_value

LONGEST_STRICT = 2  # requests of more registers pass over what does not exist or cannot be written (7.3)

_SIGNED = (Type.S16, Type.S32)


@dataclass(frozen=True, slots=True)
class NetId:
    """One parameter: its registers, low word first, and its limits."""

    start: int
    words: int = 1
    is_writable: bool = True
    is_stopped_only: bool = False
    lowest: int | None = None
    highest: int | None = None
    is_signed: bool = False

    @property
    def registers(self) -> range:
        """The registers it fills."""
        return range(self.start, self.start + self.words)

    def value(self, words: Sequence[int]) -> int:
        """Return the number that these words make."""
        number = sum(each << 16 * place for place, each in enumerate(words))
        is_negative = self.is_signed and number >> (16 * self.words - 1)
        return number - (1 << 16 * self.words) if is_negative else number

    def split(self, value: int) -> tuple[int, ...]:
        """Return the words of a number."""
        return tuple(value >> 16 * place & 0xFFFF for place in range(self.words))

    def allows(self, words: Sequence[int]) -> bool:
        """Return whether these words are in its range."""
        value = self.value(words)
        is_low = self.lowest is not None and value < self.lowest
        return not is_low and not (self.highest is not None and value > self.highest)


class NetIds:
    """All parameters by their registers."""

    def __init__(self, rows: Iterable[Parameter]) -> None:
        self.owners: dict[int, NetId] = {}
        for row in rows:
            known = self.owners.get(row.address)
            is_writable = row.access in (Access.RW, Access.COMMAND)
            if known is not None and not is_writable:
                continue  # another name for the same register
            net_id = NetId(
                start=row.address,
                words=row.words,
                is_writable=is_writable,
                is_stopped_only=bool(row.is_stopped_only),
                lowest=row.raw_min,
                highest=row.raw_max,
                is_signed=row.type in _SIGNED,
            )
            self.owners.update(dict.fromkeys(net_id.registers, net_id))

    def check_read(self, registers: range) -> None:
        """Raise what answers a read of these registers, if it is refused (7.3)."""
        if len(registers) <= LONGEST_STRICT:
            for register in registers:
                if register not in self.owners:
                    raise refuse_address(register)
        self._check_whole(registers)

    def writes(self, address: int, words: Sequence[int]) -> list[tuple[NetId, Sequence[int]]]:
        """Return what a write changes; raise what answers it, if it is refused (7.3, 7.4).

        In a request of three or more registers, what does not exist or cannot be written is passed over.
        """
        registers = range(address, address + len(words))
        if len(registers) <= LONGEST_STRICT:
            for register in registers:
                owner = self.owners.get(register)
                if owner is None or not owner.is_writable:
                    raise refuse_address(register)
        self._check_whole(registers)
        owners = {owner.start: owner for register in registers if (owner := self.owners.get(register))}
        changes = [
            (owner, words[owner.start - address : owner.start - address + owner.words])
            for owner in owners.values()
            if owner.is_writable
        ]
        for owner, its_words in changes:
            if not owner.allows(its_words):
                raise refuse_value(f"register {owner.start}: {owner.value(its_words)}")
        return changes

    def _check_whole(self, registers: range) -> None:
        """Refuse a part of a longer type, in requests of any length (7.3; erratum D-04)."""
        for register in (registers[0], registers[-1]):
            owner = self.owners.get(register)
            if owner and not (owner.registers[0] in registers and owner.registers[-1] in registers):
                raise refuse_address(register)
