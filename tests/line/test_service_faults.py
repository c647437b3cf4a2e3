"""Two starters with one address and one that talks unasked are named."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterable

import pytest

from gateway.line.rtu.bus_faults import ADDRESS_CONFLICT, BABBLING
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from tests.line.fakes import DELAY_S, TIMING, LineRig, Said, Units, poll, reply_pdu
from tests.virtual_time import run_virtually

READ = ReadHoldingRegisters(0, 10)
REPLY = adu.encode(1, READ.encode_reply(range(10)))
ONE_S = TIMING.wire_s(8 + 25) + DELAY_S + TIMING.silence_s


class Twins:
    """Two starters with one address, the second a little slower and of another opinion."""

    def __init__(self, gap_s: float, *, merged: bool = False) -> None:
        self.gap_s = gap_s
        self.merged = merged

    def __call__(self, frame: bytes) -> Iterable[Said]:
        unit, pdu = adu.decode(frame)
        first = adu.encode(unit, reply_pdu(pdu))
        if unit != 1:
            return (Said(first),)
        if self.merged:
            return (Said(bytes(byte | 0x81 for byte in first)),)
        second = adu.encode(unit, READ.encode_reply((7,) * 10))
        return Said(first), Said(second, DELAY_S + TIMING.wire_s(len(first)) + self.gap_s)


@pytest.mark.parametrize(
    "twins",
    [Twins(0.0), Twins(0.0015), Twins(0.02), Twins(0.0, merged=True)],
    ids=["at once", "1.5 ms after", "20 ms after", "merged"],
)
def test_two_starters_with_one_address_are_named_once_with_the_frames_that_show_it(twins: Twins) -> None:
    polls = [poll(str(unit), unit, 0.0) for unit in (1, 2, 3, 4)]
    rig = LineRig(twins, polls)

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(60.0)

    run_virtually(scenario())

    assert [fault[:2] for fault in rig.listener.faults] == [(ADDRESS_CONFLICT, 1)]
    _, _, text, frames = rig.listener.faults[0]
    assert "address 1" in text
    assert any("<< 01" in frame or "<< 81" in frame or "?? 01" in frame for frame in frames)


def test_a_starter_that_talks_unasked_is_named() -> None:
    rig = LineRig(Units({1, 2}), [poll(str(unit), unit, 0.0) for unit in (1, 2)])
    chance = random.Random(1)
    spoken = adu.encode(9, READ.encode_reply((7,) * 10))

    async def scenario() -> None:
        async with rig:
            for _ in range(60):
                await asyncio.sleep(chance.uniform(0.2, 0.8))
                rig.port.say(Said(spoken, 0.0))

    run_virtually(scenario())

    assert [fault[:2] for fault in rig.listener.faults] == [(BABBLING, 9)]
