"""Registers that carry what is mapped onto them, decoded by what the map says (ssw900 7.2.3)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from gateway.errors import CommandError, UsageError
from gateway.families.decode import decode_words
from gateway.families.parameters import find
from gateway.families.schema import Parameter, Profile, Table, Variant


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
