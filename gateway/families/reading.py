"""Few reads for many rows: the blocks of a family's points that are polled, and the reads of any rows.

A block joins rows where a gap costs the line less than another request (`widest_gap`); rows that a site
asks for besides are joined into the blocks that are there. `reads_for` and
`bulk_reads` join the rows that a command or a copy of the parameters needs, `rows_in` takes answers apart,
`read_back` says how a written row shows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import chain, groupby

from gateway.families.profile.decode import is_there
from gateway.families.profile.extension import EXTRA
from gateway.families.profile.parameters import find, is_read_alone, read_request, read_run, runs_of
from gateway.families.profile.procedure import Expect, Read, Seen
from gateway.families.profile.rows import Access, Parameter, Table
from gateway.families.profile.schema import Profile, Variant, once_per_profile
from gateway.families.profile.word_types import LOW_BYTE, shown_within
from gateway.modbus import LineTiming, Request

LEAST_DELAY_S = 0.005  # of a starter's answer; a longer one makes joining worth even more

SET_WITHIN_S = 2.0  # until a written row reads back as written
_CLOCK_GOES_ON_S = 5  # until the last reading of a clock that was set
_SPANNED = 24  # registers that are no parameter, rather than a second request: both take some 25 ms at 19200

_REQUEST_BYTES = 8  # a read request, with unit and CRC [APP 6.3, 6.4; SERIAL 2.5.1]
_REPLY_BYTES = 5  # what is in its reply besides the registers
_WORD_BYTES = 2


STATUS, VALUES, SLOW = GROUPS = ("status", "values", "slow")
IDLE_FACTOR = 3  # values are read so many times less often while the motor is at rest, the status is not
SLOWEST_FACTOR = 10  # slow rows are asked for ten times less often,
SLOW_AT_LEAST_S = 10.0  # and never more often than this


def slow_period_s(every_s: float) -> float:
    """Return how often slow rows are read where the status is read every so often."""
    return max(SLOW_AT_LEAST_S, SLOWEST_FACTOR * every_s)


@dataclass(frozen=True, slots=True)
class Block:
    """One read and the rows that are wanted from it; the words between them are not."""

    name: str  # unique in the plan
    group: str  # one of GROUPS, or "extra": only rows that a site asks for
    request: Request
    rows: tuple[Parameter, ...]  # by address
    extra_s: float | None = None  # the period of an extra block

    def period_s(self, every_s: float) -> float:
        """Return how often it is read at any state of the motor; `every_s` is the period of the status."""
        if self.extra_s is not None:
            return self.extra_s
        return slow_period_s(every_s) if self.group == SLOW else every_s

    def slowest_s(self, every_s: float) -> float:
        """Return the same for a motor at rest."""
        return self.period_s(every_s) * (IDLE_FACTOR if self.group == VALUES else 1)

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

    @property
    def end(self) -> int:
        """One past the last address that is read."""
        return max(row.address + row.words for row in self.rows)


def plan_blocks(
    profile: Profile, variant: Variant, *, timing: LineTiming | None = None, every_s: float = 1.0
) -> tuple[Block, ...]:
    """Return the reads that cover every point of this starter, in the order of `GROUPS`, extra ones last.

    `every_s` is the period of its status. A row that a site asks for goes with a read that passes it often
    enough, or with the slow ones where their period fits, else with the others of its period.

    On a line of this timing reads are joined over registers that are not wanted where those take less time
    than another request.

    A row is never cut, and never shares a read with one that the manual does not vouch for: where a single
    unknown register refuses a read, it must not take known ones with it.
    """
    is_extended = any(point.every_s is not None for point in profile.points.values())
    return _planned(profile, variant.firmware, timing, every_s if is_extended else 0.0)


@lru_cache(maxsize=512)
def _planned(
    profile: Profile, firmware: str | None, timing: LineTiming | None, every_s: float
) -> tuple[Block, ...]:
    variant = Variant(firmware=firmware)
    points = [point for point in profile.points.values() if is_there(profile, variant, point.source)]
    own = {point.code for point in points if point.every_s is None}  # these keep their pace
    asked = [point for point in points if point.code not in own]
    extra = {point.code: point.every_s for point in asked if point.every_s is not None}
    slow_s = slow_period_s(every_s)
    planned: list[Block] = []
    seen: set[str] = set()
    steps = [(group, None) for group in GROUPS], [(EXTRA, each_s) for each_s in sorted({*extra.values()})]
    for group, period_s in chain(*steps):
        codes = {point.code for point in points if point.group == group and point.code} - {*seen, *extra}
        for code, wanted_s in extra.items():
            is_slow = group == SLOW and slow_s <= wanted_s < 2 * slow_s
            if code in seen or not (is_slow or wanted_s == period_s):
                continue
            # A read that passes the row often enough takes it along; the status is never read in longer ones.
            row = profile.parameters[code]
            for at, block in enumerate(planned):
                if block.slowest_s(every_s) <= wanted_s and _passes(profile, block, row):
                    rows = sorted((*block.rows, row), key=lambda row: row.address)
                    planned[at] = _block(block.group, rows, block.extra_s)
                    seen.add(code)
                    break
            else:
                codes.add(code)
        seen |= codes
        rows = [profile.parameters[code] for code in sorted(codes)]
        alone = [row for row in rows if row.code in extra and is_read_alone(profile, row)]
        runs = _runs(profile, (row for row in rows if row not in alone), timing)
        planned += [_block(group, run, period_s) for run in (*runs, *([row] for row in alone))]
    return tuple(planned)


def _passes(profile: Profile, block: Block, row: Parameter) -> bool:
    """Return whether a read carries the words of a row that a site asks for."""
    is_within = block.address <= row.address and row.address + row.words <= block.end
    is_vouched = row.is_sure and block.rows[0].is_sure and not is_read_alone(profile, row)
    return block.table is row.table and is_within and is_vouched


def split(block: Block) -> tuple[Block, ...]:
    """Return one block for each row of a block that was refused.

    Their names are no planned block's: an answer that is still under way cannot be taken for another's.
    """
    return tuple(
        replace(_block(block.group, [row], block.extra_s), name=f"{block.group}:{row.code} alone")
        for row in block.rows
    )


def _block(group: str, rows: Sequence[Parameter], extra_s: float | None = None) -> Block:
    name = f"{group}:{rows[0].code}"
    return Block(name=name, group=group, request=_request(rows), rows=tuple(rows), extra_s=extra_s)


def _runs(profile: Profile, rows: Iterable[Parameter], timing: LineTiming | None) -> list[list[Parameter]]:
    def kind(row: Parameter) -> tuple[Table, bool]:
        return row.table, not row.is_sure

    runs: list[list[Parameter]] = []
    for (table, _), alike in groupby(sorted(rows, key=lambda row: (*kind(row), row.address)), key=kind):
        gap = profile.limits.max_gap
        if timing is not None and gap and not table.is_bits:
            gap = widest_gap(timing)
        runs += runs_of(alike, partial(_fits, profile.limits.most(table), gap))
    return runs


def widest_gap(timing: LineTiming) -> int:
    """Return how many registers that are not wanted take the line less time than another request."""
    request_s = timing.wire_s(_REQUEST_BYTES + _REPLY_BYTES) + timing.silence_s + LEAST_DELAY_S
    return int(request_s / timing.wire_s(_WORD_BYTES))


def _fits(longest: int, gap: int, run: Sequence[Parameter], row: Parameter) -> bool:
    end = run[-1].address + run[-1].words
    return row.address - end <= gap and row.address + row.words - run[0].address <= longest


def reads_for(profile: Profile, codes: Iterable[str]) -> tuple[Read, ...]:
    """Return as few requests as the family allows for these rows, each within its limits."""
    rows = sorted(
        (profile.parameters[code] for code in set(codes)), key=lambda row: (row.table, row.address, row.code)
    )
    return tuple(_read(run) for run in runs_of(rows, partial(_may_join, profile)))


def with_rows(profile: Profile, reads: Sequence[Read], codes: Iterable[str]) -> tuple[Read, ...]:
    """Return reads that carry these rows, too: in the same requests where all between can be read."""
    found = list(reads)
    missing = [code for code in codes if not any(code in read.codes for read in reads)]
    for code in missing:
        for place, read in enumerate(found):
            rows = sorted((find(profile, each) for each in (*read.codes, code)), key=lambda row: row.address)
            if _may_span(profile, rows):
                found[place] = _read(rows)
                break
        else:
            found.append(read_of(profile, code))
    return tuple(found)


def _may_span(profile: Profile, rows: Sequence[Parameter]) -> bool:
    """Return whether one request may carry rows of one table: all registers between are in the manual."""
    first, last = rows[0], rows[-1]
    end = last.address + last.words
    if len({row.table for row in rows}) > 1 or end - first.address > profile.limits.most(first.table):
        return False
    if not all(row.is_sure for row in rows):
        return False
    return all((first.table, address) in _registers(profile) for address in range(first.address, end))


@once_per_profile
def _registers(profile: Profile) -> frozenset[tuple[Table, int]]:
    """Return every register and coil that a row of the manual covers."""
    return frozenset(
        (row.table, address)
        for row in profile.parameters.values()
        for address in range(row.address, row.address + row.words)
    )


def rows_of_points(profile: Profile, names: Iterable[str]) -> tuple[str, ...]:
    """Return the codes of the rows from which these points are decoded."""
    codes: dict[str, None] = {}
    for name in names:
        point = profile.points[name]
        sources = rows_of_points(profile, point.none_of) if point.none_of else (point.code,)
        codes.update(dict.fromkeys(sources))
    return tuple(codes)


def rows_in(profile: Profile, read: Read, answer: Sequence[int]) -> dict[str, tuple[int, ...]]:
    """Return the raw words by code that the answer to a read carries; a bit is 0 or 1."""
    rows = [find(profile, code) for code in read.codes]
    start = min(row.address for row in rows)
    return {
        row.code: tuple(int(word) for word in answer[row.address - start : row.address - start + row.words])
        for row in rows
    }


def read_of(profile: Profile, code: str) -> Read:
    """Return the read of one row; CommandError when there is none, or it cannot be read."""
    row = find(profile, code)
    return Read(request=read_request(profile, row), codes=(row.code,))


def holds(row: Parameter, words: tuple[int, ...], seen: Seen) -> bool:
    """Return whether the row was seen to hold these words already."""
    return tuple(word & _mask(row) for word in seen.get(row.code, ())) == words


def read_back(profile: Profile, wanted: Iterable[tuple[Parameter, tuple[int, ...]]]) -> Expect:
    """Return the expectation that all of these rows (at least one) read back as written."""
    shown = [(row, *_shown_by(profile, row, words)) for row, words in wanted]
    reads = reads_for(profile, (code for _, code, _, _ in shown))
    first, *others = (
        Expect(
            reads,
            code,
            is_one_of=shown_within(row.type, words, _CLOCK_GOES_ON_S),
            within_s=SET_WITHIN_S,
            mask=mask,
        )
        for row, code, mask, words in shown
    )
    return replace(first, also=tuple(others))


def _shown_by(profile: Profile, row: Parameter, words: tuple[int, ...]) -> tuple[str, int, tuple[int, ...]]:
    """Return the row that shows that these words were written, which of its bits, and what they are then."""
    other = profile.shown_by.get(row.code)
    if other is None or words != (other.written,):
        return row.code, _mask(row), words
    return other.code, other.mask, (other.becomes,)


def _mask(row: Parameter) -> int:
    return 0xFF if row.type in LOW_BYTE else 0xFFFF


def _may_join(profile: Profile, run: list[Parameter], row: Parameter) -> bool:
    """Return whether one request may span this row too, with nothing in between that could refuse it."""
    size = row.address + row.words - run[0].address
    if row.table is not run[0].table or size > profile.limits.most(row.table):
        return False
    end = max(one.address + one.words for one in run)
    if row.table.is_bits:
        return all((row.table, address) in profile.rows_at for address in range(end, row.address))
    return row.address - end <= profile.limits.max_gap


def _read(run: list[Parameter]) -> Read:
    return Read(request=_request(run), codes=tuple([row.code for row in run]))


def _request(run: Sequence[Parameter]) -> Request:
    start = run[0].address
    return read_run(run[0].table, start, max(row.address + row.words for row in run) - start)


def readable_codes(profile: Profile) -> tuple[str, ...]:
    """Return every row that can be read."""
    return tuple(row.code for row in profile.parameters.values() if row.access is not Access.NONE)


def is_setting(profile: Profile, row: Parameter) -> bool:
    """Return whether a row is a parameter that people set, neither a reading nor an output."""
    is_one = row.code.startswith(profile.rows.settings) and not row.code.startswith(profile.rows.clock)
    return row.access is Access.RW and row.table is not Table.COIL and is_one


def is_set_by_people(profile: Profile, row: Parameter) -> bool:
    """Return whether a row changes only when somebody sets it: not by itself."""
    return is_setting(profile, row) and not row.code.startswith(profile.rows.automatic)


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
    found: list[Read] = []
    for group in [[code] for code in unsure] if reads_zero else [unsure]:
        found += reads_for(bulk, group)
    found += reads_for(bulk, sure)
    return (*found, *(read_of(profile, code) for code in unnamed))


def halves(profile: Profile, read: Read) -> tuple[Read, ...]:
    """Return two requests for a read of several rows that was refused; none for a single row."""
    if len(read.codes) < 2:
        return ()
    rows = sorted((profile.parameters[code] for code in read.codes), key=lambda row: row.address)
    middle = len(rows) // 2
    while middle < len(rows) - 1 and rows[middle].address == rows[middle - 1].address:
        middle += 1  # names of one register stay together
    return tuple(_read(part) for part in (rows[:middle], rows[middle:]))
