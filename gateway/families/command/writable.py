"""One row of a starter: which value a `set` may give it, whether it holds it, how it is read back."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gateway.families.command.control_word import Seen
from gateway.families.profile.parameters import find, read_request, to_words
from gateway.families.profile.procedure import Expect, Read
from gateway.families.profile.refusals import refused
from gateway.families.profile.schema import Access, Parameter, Profile, Table, Type, Variant
from gateway.families.profile.word_types import shown_within
from gateway.families.reading.bulk import reads_for

SET_WITHIN_S = 2.0  # until a written row reads back as written
_CLOCK_GOES_ON_S = 5  # until the last reading of a clock that was set

# What shows that a bit has acted, where the manual does not say whether the bit itself stays: the row, its
# bits and what they become. S5.6.2 bit 0 aborts the oriented start-up, S5.6.1 bit 2 shows it (table A.2).
_SHOWN_BY: dict[tuple[str, tuple[int, ...]], tuple[str, int, tuple[int, ...]]] = {
    ("S5.6.2", (1,)): ("S5.6.1", 0x04, (0,))
}

# What is written there lands in another row: in a command word too, if it is mapped so (ssw900 7.2.3).
MAPPED_WRITES = range(1600, 1620)


def settable_words(profile: Profile, variant: Variant, row: Parameter, value: object) -> tuple[int, ...]:
    """Return the words that set a row to a value; CommandError when no `set` may do so."""
    if row.code in profile.protected.connection:
        raise refused(
            "would_cut_connection", f"change {row.code} at the starter, together with the line's settings"
        )
    if row.code in profile.protected.actions:
        raise refused("not_writable", f"{row.code} is an action on all parameters: do it at the starter")
    is_mapped = profile.family == "ssw900" and row.table is Table.HOLDING and row.address in MAPPED_WRITES
    if row.table.is_bits or row.access is Access.COMMAND or is_mapped:
        raise refused("not_writable", f"{row.code} is not written by set, but by the verbs of the family")
    return to_words(profile, row, value, variant=variant)


def is_kept(row: Parameter) -> bool:
    """Return whether a write of this row goes to non-volatile memory: all but what commands outputs."""
    return not row.code.startswith(("VB", "S"))


def holds(row: Parameter, words: tuple[int, ...], seen: Seen) -> bool:
    """Return whether the row was seen to hold these words already."""
    return tuple(word & _mask(row) for word in seen.get(row.code, ())) == words


def read_of(profile: Profile, code: str) -> Read:
    """Return the read of one row; CommandError when there is none, or it cannot be read."""
    row = find(profile, code)
    return Read(request=read_request(profile, row), codes=(row.code,))


def read_back(profile: Profile, wanted: Iterable[tuple[Parameter, tuple[int, ...]]]) -> Expect:
    """Return the expectation that all of these rows (at least one) read back as written."""
    shown = [(row, *_SHOWN_BY.get((row.code, words), (row.code, _mask(row), words))) for row, words in wanted]
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


def _mask(row: Parameter) -> int:
    return 0xFF if row.type in (Type.LOW_U8, Type.LOW_S8, Type.LOW_ENUM) else 0xFFFF
