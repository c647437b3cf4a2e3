"""Replies to polls: whatever has changed in them, they say what their words say on their own."""

from __future__ import annotations

import random

import pytest

from gateway.families import FAMILIES, Variant, load_profile
from gateway.families.reading import plan_blocks, split
from gateway.starters.state import Reading, ReplyReader, sources_of

VARIANT = Variant(model="SSW-06 85.0A", firmware="1.30")


@pytest.mark.parametrize("is_split", [False, True])  # row by row, as after a refusal
@pytest.mark.parametrize("family", FAMILIES)
def test_a_reply_says_what_its_words_say_whatever_came_before_it(family: str, *, is_split: bool) -> None:
    profile, chance = load_profile(family), random.Random(family)
    known: dict[str, Reading] = {}
    reader = ReplyReader(profile, lambda: known)
    whole = plan_blocks(profile, VARIANT)
    for block in [row for each in whole for row in split(each)] if is_split else whole:
        is_bits, size = block.table.is_bits, block.end - block.address
        words = [0] * size
        for _ in range(30):
            for place in chance.sample(range(size), chance.randint(0, min(2, size))):
                words[place] = chance.choice((True, False) if is_bits else (0, 1, 7, 0x4123, 0xFFFF))
            rows = {
                same.code: tuple(map(int, words[row.address - block.address :][: row.words]))
                for row in block.rows
                for same in profile.rows_at[row.table, row.address]
            }

            said = reader.read(block.name, block, VARIANT, tuple(words))

            assert said == sources_of(profile).decode(VARIANT, rows, known=known)
            known |= said.points
