"""Few requests that read a given set of rows, and how their answers are taken apart again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gateway.families.parameters import find, read_run
from gateway.families.procedure import Read
from gateway.families.schema import Parameter, Profile, Table


def reads_for(profile: Profile, codes: Iterable[str]) -> tuple[Read, ...]:
    """Return as few requests as the family allows for these rows, each within its limits."""
    rows = sorted(
        (profile.parameters[code] for code in set(codes)), key=lambda row: (row.table, row.address, row.code)
    )
    runs: list[list[Parameter]] = []
    for row in rows:
        if runs and _may_join(profile, runs[-1], row):
            runs[-1].append(row)
        else:
            runs.append([row])
    return tuple(_read(run) for run in runs)


def rows_of_points(profile: Profile, names: Iterable[str]) -> tuple[str, ...]:
    """Return the codes of the rows from which these points are told."""
    codes: dict[str, None] = {}
    for name in names:
        point = profile.points[name]
        told_from = rows_of_points(profile, point.none_of) if point.none_of else (point.code,)
        codes.update(dict.fromkeys(told_from))
    return tuple(codes)


def rows_in(profile: Profile, read: Read, answer: Sequence[int]) -> dict[str, tuple[int, ...]]:
    """Return the raw words by code that the answer to a read carries; a coil is 0 or 1."""
    rows = [find(profile, code) for code in read.codes]
    start = min(row.address for row in rows)
    return {
        row.code: tuple(int(word) for word in answer[row.address - start : row.address - start + row.words])
        for row in rows
    }


def _may_join(profile: Profile, run: list[Parameter], row: Parameter) -> bool:
    """Return whether one request may span this row too, with nothing in between that could refuse it."""
    limits = profile.limits
    first, end = run[0], max(one.address + one.words for one in run)
    is_bit = row.table is Table.COIL
    longest = limits.read_bits if is_bit else limits.read_registers
    if row.table is not first.table or row.address + row.words - first.address > longest:
        return False
    if is_bit:
        return all((Table.COIL, address) in profile.rows_at for address in range(end, row.address))
    return row.address - end <= limits.max_gap


def _read(run: list[Parameter]) -> Read:
    start = run[0].address
    end = max(row.address + row.words for row in run)
    return Read(request=read_run(run[0].table, start, end - start), codes=tuple(row.code for row in run))
