"""Modbus exceptions by chance or for a while: no starter stays blind, and the others notice nothing."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass, field

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.records import AvailabilityRecord, EventRecord, StateRecord
from gateway.starters.telemetry.polling import LONGEST_PAUSE_S
from tests.starters.four_starters import Site, site
from tests.starters.rig import virtually

STATUS = {"ssw06": (3, 5001), "ssw07": (3, 5001), "ssw900": (3, 680), "sst": (4, 19)}  # function, register
LATEST_S = 2.0 * LONGEST_PAUSE_S  # what is read row by row comes back one row after the other
READS = (1, 2, 3, 4)


@dataclass
class Refusing:
    """A starter that refuses its status word `left` times."""

    here: Site
    family: str
    left: int
    code: int
    last_s: float = 0.0
    asked: int = field(default=0)

    def __post_init__(self) -> None:
        unit = self.here.unit(self.family)
        self._handle, unit.handle = unit.handle, self._refuse  # type: ignore[method-assign]

    def _refuse(self, pdu: bytes, now_s: float) -> bytes | None:
        function, register = STATUS[self.family]
        begin, count = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        if not self.left or pdu[0] != function or not begin <= register < begin + count:
            return self._handle(pdu, now_s)
        self.left, self.last_s = self.left - 1, now_s
        return bytes((pdu[0] | 0x80, self.code))

    async def over(self) -> None:
        while self.left:  # noqa: ASYNC110 - in virtual time
            await asyncio.sleep(0.1)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("count", "code"), [(1, 3), (3, 2), (12, 1), (50, 4)])
@virtually
async def test_a_status_word_refused_for_a_while_is_known_soon_after(
    family: str, count: int, code: int
) -> None:
    async with site() as here:
        refusing = Refusing(here, family, count, code)
        await refusing.over()
        await asyncio.sleep(LATEST_S)

        ours = [r for r in here.sink.records if getattr(r, "starter", "") == family]
        states = [r.state for r in ours if isinstance(r, StateRecord)]
        available = [r.state for r in ours if isinstance(r, AvailabilityRecord)]
        events = [r.code for r in ours if isinstance(r, EventRecord)]
        assert states[-1:] != ["unknown"]
        assert here.telemetries[family].snapshot.good_values()["running"] is False
        # A word answered in another form (its bits as coils) is known; then its block is tried again.
        assert available == ["degraded", "online"] * (len(available) // 2)
        assert events == ["degraded", "recovered"] * (len(events) // 2)
        assert len(events) <= 4
        if count >= 12:
            assert "unknown" in states
            assert events
        others = [r for r in here.sink.of(EventRecord) if r.starter != family]
        assert others == []


@virtually
async def test_twelve_refusals_in_a_row_are_over_within_a_minute_and_a_half() -> None:
    async with site() as here:
        refusing = Refusing(here, "ssw07", 12, 2)
        await asyncio.wait_for(refusing.over(), 60.0)


@pytest.mark.parametrize("code", [1, 2, 6])
@virtually
async def test_a_twentieth_of_exceptions_costs_no_more_than_a_tenth_of_the_answers(code: int) -> None:
    plain = await answers(0.0, code)
    impaired = await answers(0.05, code)

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
