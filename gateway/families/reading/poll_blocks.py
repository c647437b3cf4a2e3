"""Which registers are read together for a family's points: where a gap costs less than another request."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from math import inf
from typing import Any

from gateway.families.profile.decode import is_known
from gateway.families.profile.parameters import read_run, runs_of
from gateway.families.profile.per_profile import ProfileMemo
from gateway.families.profile.rows import Parameter, Table
from gateway.families.profile.schema import Limits, Profile, Variant
from gateway.modbus.pdu import Request
from gateway.modbus.timing import LineTiming

LEAST_DELAY_S = 0.005  # of a starter's answer; a longer one makes joining worth even more

_REQUEST_BYTES = 8  # a read request, with unit and CRC [APP 6.3, 6.4; SERIAL 2.5.1]
_REPLY_BYTES = 5  # what is in its reply besides the registers
_WORD_BYTES = 2


def cheapest_runs(rows: Sequence[Parameter], timing: LineTiming, *, longest: int) -> list[list[Parameter]]:
    """Return the rows, which are in order of address, in the runs that take the line the least time.

    All registers between two rows must be readable; no run has more than `longest` registers.
    """
    request_s = timing.wire_s(_REQUEST_BYTES + _REPLY_BYTES) + timing.silence_s + LEAST_DELAY_S
    word_s = timing.wire_s(_WORD_BYTES)
    least_s = [0.0] + [inf] * len(rows)  # for the first so many rows
    starts = [0] * (len(rows) + 1)  # of the last run in that
    for count in range(1, len(rows) + 1):
        end = 0
        for start in range(count - 1, -1, -1):
            end = max(end, rows[start].address + rows[start].words)
            size = end - rows[start].address
            if size > longest:
                break
            cost_s = least_s[start] + request_s + size * word_s
            if cost_s < least_s[count]:
                least_s[count], starts[count] = cost_s, start
    runs: list[list[Parameter]] = []
    count = len(rows)
    while count:
        runs.append(list(rows[starts[count] : count]))
        count = starts[count]
    return runs[::-1]


GROUPS = ("status", "values", "slow")
_Place = tuple[str | None, frozenset[str], LineTiming | None]  # firmware, rows read in another way, timing


@dataclass(frozen=True, slots=True)
class Block:
    """One read and the rows that are wanted from it; the words between them are not."""

    name: str  # unique in the plan
    group: str  # one of GROUPS
    request: Request
    rows: tuple[Parameter, ...]  # by address

    @property
    def codes(self) -> tuple[str, ...]:
        """The codes of the rows."""
        return tuple(row.code for row in self.rows)

    @property
    def table(self) -> Table:
        """The table that is read."""
        return self.rows[0].table

    @property
    def address(self) -> int:
        """The first address that is read."""
        return self.rows[0].address

    def rows_in(self, profile: Profile, value: Sequence[Any]) -> dict[str, tuple[int, ...]] | None:
        """Return the raw words by code from what its request decoded, aliases of its rows included.

        None when the answer shows that it is not of these rows.
        """
        found: dict[str, tuple[int, ...]] = {}
        first = self.address
        for row in self.rows:
            offset = row.address - first
            words = tuple(int(word) for word in value[offset : offset + row.words])
            for same in profile.rows_at[row.table, row.address]:
                found[same.code] = words
        return found


_plans: ProfileMemo[_Place, tuple[Block, ...]] = ProfileMemo()


def plan_blocks(
    profile: Profile, variant: Variant, *, without: Collection[str] = (), timing: LineTiming | None = None
) -> tuple[Block, ...]:
    """Return the reads that cover every point of this starter, in the order of `GROUPS`.

    Rows `without` which it is planned are read in another way. On a line of this timing reads are joined over
    registers that are not wanted where those take less time than another request.

    A row is never cut, and never shares a read with one that the manual does not vouch for: where a single
    unknown register refuses a read, it must not take known ones with it.
    """
    key = variant.firmware, frozenset(without), timing
    return _plans.get(profile, key, lambda: _planned(profile, variant, without=key[1], timing=timing))


def _planned(
    profile: Profile, variant: Variant, *, without: frozenset[str], timing: LineTiming | None
) -> tuple[Block, ...]:
    planned: list[Block] = []
    seen: set[str] = set(without)
    for group in GROUPS:
        codes = {
            point.code
            for point in profile.points.values()
            if point.group == group and point.code and is_known(point.since_firmware, variant)
        }
        rows = [profile.parameters[code] for code in codes - seen]
        seen |= codes
        planned += [_block(group, run) for run in _runs(rows, profile.limits, timing)]
    return tuple(planned)


def split(block: Block) -> tuple[Block, ...]:
    """Return one block for each row of a block that was refused; a single row stays as it is."""
    return tuple(_block(block.group, [row]) for row in block.rows)


def _block(group: str, rows: Sequence[Parameter]) -> Block:
    first, last = rows[0], rows[-1]
    request = read_run(first.table, first.address, last.address + last.words - first.address)
    return Block(name=f"{group}:{first.code}", group=group, request=request, rows=tuple(rows))


def _runs(rows: Iterable[Parameter], limits: Limits, timing: LineTiming | None) -> list[list[Parameter]]:
    def kind(row: Parameter) -> tuple[Table, bool]:
        return row.table, not row.is_sure

    runs: list[list[Parameter]] = []
    for (table, _), alike in groupby(sorted(rows, key=lambda row: (*kind(row), row.address)), key=kind):
        if timing is not None and not table.is_bits and limits.max_gap:
            runs += cheapest_runs(list(alike), timing, longest=limits.read_registers)
            continue
        longest = limits.read_bits if table.is_bits else limits.read_registers
        runs += runs_of(alike, partial(_fits, longest=longest, max_gap=limits.max_gap))
    return runs


def _fits(run: Sequence[Parameter], row: Parameter, *, longest: int, max_gap: int) -> bool:
    end = run[-1].address + run[-1].words
    return row.address - end <= max_gap and row.address + row.words - run[0].address <= longest
