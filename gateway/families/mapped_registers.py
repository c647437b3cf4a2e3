"""All that is read often in one request: points mapped onto registers made for that (ssw900 7.2.3).

Each mapped word has a companion in the same reply that reads the map itself (C8.1.1.x is a parameter like
any other). So a reply proves what it is made of, and no value is taken for another after a change of the map.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from gateway.errors import CommandError, UsageError
from gateway.families.command.interlock import points_needed
from gateway.families.profile.decode import decode_words
from gateway.families.profile.parameters import RowWords, find, writes_for
from gateway.families.profile.procedure import Preparation, Procedure, Read, Seen, WriteStep
from gateway.families.profile.rows import Parameter, Table
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading import Block, holds, plan_blocks, read_back, read_of, reads_for, rows_of_points
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import LineTiming

VERB = "fast_words"
RULES = ("is_stopped",)  # the map has the property Stopped (ssw900 C8.1)

_FAST_GROUPS = ("status", "values")


@dataclass(frozen=True, slots=True)
class MappedBlock(Block):
    """One read of mapped words: those of the rows first, then as many of the map itself."""

    map: tuple[int, ...] = ()  # what the map must hold; the second half of a reply says its first half

    def rows_in(self, profile: Profile, value: Sequence[Any]) -> dict[str, tuple[int, ...]] | None:
        """Return the raw words by code; None when the map is not ours any more."""
        half = len(self.map) // 2
        if tuple(value[half:]) != self.map[:half]:
            return None
        found: dict[str, tuple[int, ...]] = {}
        offset = 0
        for row in self.rows:
            words = tuple(int(word) for word in value[offset : offset + row.words])
            found |= {same.code: words for same in profile.rows_at[row.table, row.address]}
            offset += row.words
        return found


def fast_block(profile: Profile, variant: Variant, *, missing: Collection[str] = ()) -> MappedBlock | None:
    """Return the one read of as many often-read rows as fit, the status first; None when there is none.

    Rows that are `missing` in this starter are left out: a mapped parameter that does not exist reads 0
    (ssw900 7.2.4). So are those that the manual does not vouch for.
    """
    layout = profile.fast_words
    if layout is None:
        return None
    room = layout.words // 2
    rows: list[Parameter] = []
    for block in plan_blocks(profile, variant, without=missing):
        for row in block.rows if block.group in _FAST_GROUPS else ():
            if row.table is Table.HOLDING and row.is_sure and row.words <= room:
                rows.append(row)
                room -= row.words
    if not rows:
        return None
    values = tuple(row.address for row in rows for _ in range(row.words))  # twice the same id: low word first
    proof = range(layout.map, layout.map + len(values))
    request = ReadHoldingRegisters(layout.read, 2 * len(values))
    return MappedBlock("status:fast_words", "status", request, tuple(rows), (*values, *proof))


def plan_with(
    profile: Profile, variant: Variant, fast: MappedBlock | None, *, timing: LineTiming | None = None
) -> tuple[Block, ...]:
    """Return all reads of a starter, the fast one first where there is one, as `plan_blocks` does."""
    others = plan_blocks(profile, variant, without=fast.codes if fast else (), timing=timing)
    return (fast, *others) if fast else others


def probes(profile: Profile, variant: Variant) -> tuple[Read, ...]:
    """Return a read of each row that may be mapped: so short that what does not exist is refused (S9-02)."""
    block = fast_block(profile, variant)
    return () if block is None else tuple(read_of(profile, code) for code in block.codes)


def prepare_map(profile: Profile, block: MappedBlock) -> Preparation:
    """Return what to read before the map is written: the map, and whether the motor stands."""
    codes = (row.code for row, _ in _wanted(profile, block))
    standstill = rows_of_points(profile, points_needed(profile, RULES))
    return Preparation(reads=reads_for(profile, (*codes, *standstill)), requires=RULES)


def build_map(profile: Profile, block: MappedBlock, *, seen: Seen) -> Procedure:
    """Return the writes that make the map what the block needs; only what differs is written."""
    wanted = _wanted(profile, block)
    changes = [(row, words) for row, words in wanted if not holds(row, words, seen)]
    return Procedure(
        steps=tuple(WriteStep(request) for request, _ in writes_for(profile, changes)),
        verify=read_back(profile, wanted),
        is_unchanged=not changes,
        subjects=tuple(row.code for row, _ in changes),
        wears=len(changes),
    )


def mapped(profile: Profile, block: MappedBlock) -> dict[str, tuple[int, ...]]:
    """Return what the rows of the map must hold, by code."""
    return {row.code: words for row, words in _wanted(profile, block)}


def _wanted(profile: Profile, block: MappedBlock) -> list[RowWords]:
    layout = profile.fast_words
    start = 0 if layout is None else layout.map
    return [
        (profile.rows_at[Table.HOLDING, address][0], (word,)) for address, word in enumerate(block.map, start)
    ]


def decode_mapped(
    profile: Profile, variant: Variant, ids: Sequence[str], words: Sequence[int]
) -> dict[str, dict[str, Any]]:
    """Return what mapped words mean, as `decode_words` does; UsageError when map and words do not fit.

    `ids` are net ids or codes in the order of the registers. A parameter of two words may stand once or, as
    in the starter, once for each of its words; its low word comes first.
    """
    rows = [
        row
        for row, same in groupby(_row(profile, each) for each in ids)
        for _ in range(-(-len(list(same)) // row.words))
    ]
    count = sum(row.words for row in rows)
    if count != len(words):
        raise UsageError(f"--map names parameters of {count} words together, but {len(words)} were given")
    found: dict[str, dict[str, Any]] = {}
    at = 0
    for row in rows:
        found |= decode_words(profile, variant, row.table, row.address, words[at : at + row.words])
        at += row.words
    return found


def _row(profile: Profile, name: str) -> Parameter:
    """Return the parameter with this net id or code; UsageError when there is none."""
    if not name.isdigit():
        try:
            return find(profile, name)
        except CommandError as error:
            raise UsageError(f"--map: {profile.title} has no {name!r}") from error
    rows = profile.rows_at.get((Table.HOLDING, int(name)), ())
    if not rows:
        raise UsageError(f"--map: no parameter of {profile.family} has the net id {name}")
    return rows[0]
