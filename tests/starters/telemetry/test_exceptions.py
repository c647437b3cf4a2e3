"""Modbus exceptions by chance cost few answers."""

from __future__ import annotations

import asyncio
import random

from gateway.families.profile.load import FAMILIES
from tests.starters.four_starters import Site, site
from tests.starters.rig import virtually

READS = (1, 2, 3, 4)


@virtually
async def test_a_twentieth_of_exceptions_costs_no_more_than_a_tenth_of_the_answers() -> None:
    plain = await answers(0.0, 2)
    impaired = await answers(0.05, 2)

    for family in FAMILIES:
        assert impaired[family] >= 0.9 * plain[family], family


async def answers(share: float, code: int) -> dict[str, int]:
    """Return how many reads each starter answers in a minute."""
    dice, counts = random.Random(code), dict.fromkeys(FAMILIES, 0)

    def impair(here: Site, family: str) -> None:
        unit = here.unit(family)
        handle = unit.handle

        def refuse(pdu: bytes, now_s: float) -> bytes | None:
            if pdu[0] in READS and dice.random() < share:
                return bytes((pdu[0] | 0x80, code))
            counts[family] += 1
            return handle(pdu, now_s)

        unit.handle = refuse  # type: ignore[method-assign]

    async with site() as here:
        for family in FAMILIES:
            impair(here, family)
        await asyncio.sleep(60.0)
    return counts
