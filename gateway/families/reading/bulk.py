"""Few requests that read a given set of rows, and how their answers are taken apart again.

Reading many rows of a starter: which rows there are to read, in as few requests as it takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gateway.families.profile.parameters import find, raw_row, read_run
from gateway.families.profile.procedure import Read
from gateway.families.profile.schema import Access, Parameter, Profile, Table


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
    """Return the raw words by code that the answer to a read carries; a bit is 0 or 1."""
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
    is_bit = row.table.is_bits
    longest = limits.read_bits if is_bit else limits.read_registers
    if row.table is not first.table or row.address + row.words - first.address > longest:
        return False
    if is_bit:
        return all((row.table, address) in profile.rows_at for address in range(end, row.address))
    return row.address - end <= limits.max_gap


def _read(run: list[Parameter]) -> Read:
    start = run[0].address
    end = max(row.address + row.words for row in run)
    return Read(request=read_run(run[0].table, start, end - start), codes=tuple(row.code for row in run))


_SPANNED = 24  # registers that are no parameter, rather than a second request: both take some 25 ms at 19200
_SETTING_LETTERS = ("P", "C", "R")  # Pnnn, Cn.n, Rn; COILn is none, VBnn and S5.3 are outputs
_CLOCK = "C6.3."  # SSW900
# SSW900: the maps of the indirect registers, which the gateway may set itself, and what the SoftPLC writes.
_NOT_OF_PEOPLE = ("C8.1.", "C11.")


def readable_codes(profile: Profile, *, with_unnamed: bool = False) -> tuple[str, ...]:
    """Return every row that can be read; `with_unnamed` adds P000 to P999 where those are raw words."""
    codes = [row.code for row in profile.parameters.values() if row.access is not Access.NONE]
    if with_unnamed and profile.raw_range is not None:
        first, last = profile.raw_range
        named = {row.address for row in profile.parameters.values() if row.table is Table.HOLDING}
        rows = (raw_row(profile, address) for address in range(first, last + 1) if address not in named)
        codes += [row.code for row in rows if row is not None]
    return tuple(codes)


def is_setting(row: Parameter) -> bool:
    """Return whether a row is a parameter that people set, neither a reading nor an output."""
    letter = row.code[:1] if row.table is not Table.COIL else ""
    return row.access is Access.RW and letter in _SETTING_LETTERS and not row.code.startswith(_CLOCK)


def is_set_by_people(row: Parameter) -> bool:
    """Return whether a row changes only when somebody sets it: not by itself, not by the gateway."""
    return is_setting(row) and not row.code.startswith(_NOT_OF_PEOPLE)


def bulk_reads(profile: Profile, codes: Iterable[str], *, longest: int | None = None) -> tuple[Read, ...]:
    """Return few requests for these rows, of at most `longest` registers each.

    A row that the manual does not vouch for has a request of its own where unknown registers read 0 in a
    longer one (ssw900 7.3): a 0 would say nothing.
    """
    rows = {code: profile.parameters.get(code) for code in codes}
    limits = profile.limits
    reads_zero = limits.max_gap > 0
    sure = [code for code, row in rows.items() if row is not None and row.is_sure]
    unsure = [code for code, row in rows.items() if row is not None and not row.is_sure]
    unnamed = [code for code, row in rows.items() if row is None]
    wide = limits.model_copy(
        update={
            "max_gap": _SPANNED if reads_zero else 0,
            "read_registers": min(limits.read_registers, longest or limits.read_registers),
        }
    )
    bulk = profile.model_copy(update={"limits": wide})
    found = [*reads_for(bulk, sure)]
    for group in [[code] for code in unsure] if reads_zero else [unsure]:
        found += reads_for(bulk, group)
    return (*found, *(_unnamed(profile, code) for code in unnamed))


def halves(profile: Profile, read: Read) -> tuple[Read, ...]:
    """Return two requests for a read of several rows that was refused; none for a single row."""
    if len(read.codes) < 2:
        return ()
    rows = sorted((profile.parameters[code] for code in read.codes), key=lambda row: row.address)
    middle = len(rows) // 2
    while middle < len(rows) - 1 and rows[middle].address == rows[middle - 1].address:
        middle += 1  # names of one register stay together
    return tuple(_run(part) for part in (rows[:middle], rows[middle:]))


def _unnamed(profile: Profile, code: str) -> Read:
    return _run([find(profile, code)])


def _run(rows: list[Parameter]) -> Read:
    start = rows[0].address
    end = max(row.address + row.words for row in rows)
    return Read(read_run(rows[0].table, start, end - start), tuple(row.code for row in rows))
