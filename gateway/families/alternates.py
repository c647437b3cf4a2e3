"""Other requests for a starter while one of its earlier replies would pass for the next.

Alternates read the same registers by replies of other shapes: more registers, or the bits of a word. Fences
are any reads of different shapes, whose answers prove that nothing earlier can come. Only registers that a
manual names are read. Should a starter refuse an alternate (ssw06-es 5.4.8), its line gives up only that one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import Any

from gateway.families.profile.parameters import READS, is_read_alone, read_run, runs_of
from gateway.families.profile.rows import Access, Parameter, Table, Type
from gateway.families.profile.schema import Profile, once_per_profile
from gateway.modbus import ReadCoils, ReadHoldingRegisters, ReadInputRegisters, Request

MOST = 8  # alternates of one request
FENCES = 8  # with fewer shapes lost and late replies leave a unit out of step for long

Cut = Callable[[Any], Any]
Alternate = tuple[Request, Cut]

_WORD_BITS = 16
_BYTE_BITS = 8


def other_reads(profile: Profile) -> tuple[Callable[[Request], tuple[Alternate, ...]], tuple[Request, ...]]:
    """Return what gives the alternates of this family's reads, and its fences."""
    return partial(alternates, profile), fences(profile)


@lru_cache(maxsize=512)  # of the polls; commands are few
def alternates(profile: Profile, request: Request) -> tuple[Alternate, ...]:
    """Return equivalent reads whose replies differ in length or function from this one's and one another's.

    The second of each pair takes what was asked for from the value that such a read decodes.
    """
    if not isinstance(request, ReadCoils | ReadHoldingRegisters | ReadInputRegisters):
        return ()
    table = next(table for table, kind in READS.items() if kind is type(request))
    if any(is_read_alone(profile, row) for row in profile.rows_at.get((table, request.address), ())):
        return ()
    found = [*_as_coils(profile, table, request.address, request.count)]
    found += _longer(profile, table, request.address, request.count)
    return tuple(found[:MOST])


@lru_cache(maxsize=64)
def fences(profile: Profile) -> tuple[Request, ...]:
    """Return the shortest reads that every starter of this family replies to, no two in the same shape.

    They are bits in one or more bytes, registers, first those for which the manual vouches, and a read by
    each function that the family does not have: a refusal is a reply too [APP 7].
    """
    found: dict[tuple[Table, int], Request] = {}
    for table, first, end in sorted(readable_runs(profile), key=partial(_is_doubtful, profile)):
        for step in range(1, FENCES + 1):
            size = step * _BYTE_BITS if table.is_bits else step
            if size <= end - first:
                found.setdefault((table, step), read_run(table, first, size))
    for table, kind in READS.items():
        if kind.function not in profile.limits.functions:
            found[table, 1] = read_run(table, 0, 1)
    return tuple(sorted(found.values(), key=lambda read: read.reply_size() or 0)[:FENCES])


@once_per_profile
def readable_runs(profile: Profile) -> tuple[tuple[Table, int, int], ...]:
    """Return the runs of addresses that may be read in one request: table, first, one past the last.

    Gaps of up to `limits.max_gap` registers may be read too; coils that only commands name may not.
    """

    def follows(run: list[Parameter], row: Parameter) -> bool:
        gap = 0 if row.table is Table.COIL else profile.limits.max_gap
        return row.table is run[0].table and row.address - _end(run) <= gap

    rows = (row for row in profile.parameters.values() if row.access in (Access.RO, Access.RW))
    runs = runs_of(sorted(rows, key=lambda row: (row.table, row.address)), follows)
    return tuple((run[0].table, run[0].address, _end(run)) for run in runs)


def _end(run: Sequence[Parameter]) -> int:
    return max(row.address + row.words for row in run)


def _is_doubtful(profile: Profile, run: tuple[Table, int, int]) -> bool:
    table, first, end = run
    rows = (row for at in range(first, end) for row in profile.rows_at.get((table, at), ()))
    return not all(row.is_sure for row in rows)


def _as_coils(profile: Profile, table: Table, address: int, count: int) -> Iterator[Alternate]:
    """Return the read of a word's bits as coils, where the manual gives them (ssw07 5.3.2)."""
    if table is not Table.HOLDING or count != 1:
        return
    for row in profile.rows_at.get((table, address), ()):
        if row.type is not Type.BITS:
            continue
        bits = [profile.parameters.get(f"{row.code}.{bit}") for bit in range(_WORD_BITS)]
        first = bits[0]
        if first is None or first.access is Access.COMMAND:
            continue
        places = [bit.address for bit in bits if bit is not None and bit.table is Table.COIL]
        if places == list(range(first.address, first.address + _WORD_BITS)):
            yield ReadCoils(first.address, _WORD_BITS), _to_word


def _longer(profile: Profile, table: Table, address: int, count: int) -> Iterator[Alternate]:
    end = address + count
    is_bit = table is Table.COIL
    for run_table, first, run_end in readable_runs(profile):
        if run_table is not table or not first <= address or not end <= run_end:
            continue
        size = -(-count // _BYTE_BITS) * _BYTE_BITS + 1 if is_bit else count + 1
        while size <= min(profile.limits.most(table), run_end - first):
            start = min(address, run_end - size)
            yield read_run(table, start, size), partial(_cut, start=address - start, count=count)
            size += _BYTE_BITS if is_bit else 1


def _cut(value: Sequence[Any], *, start: int, count: int) -> tuple[Any, ...]:
    return tuple(value[start : start + count])


def _to_word(bits: Sequence[bool]) -> tuple[int]:
    return (sum(1 << place for place, bit in enumerate(bits) if bit),)
