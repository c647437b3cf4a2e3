"""A refusal in passing, or a lost reply, neither hides the right device nor lets a wrong one pass."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

import pytest

from gateway.modbus.codes import ExceptionCode
from gateway.records import Phase
from tests.starters.identity.habits import Answer, as_printed, at_first, device, is_fc43
from tests.starters.one_starter import one_starter
from tests.starters.rig import virtually

VB00 = bytes.fromhex("03 13 88 00 01")
CODES = (
    ExceptionCode.ILLEGAL_FUNCTION,
    ExceptionCode.ILLEGAL_DATA_ADDRESS,
    ExceptionCode.SERVER_DEVICE_FAILURE,
    ExceptionCode.SERVER_DEVICE_BUSY,
)


@dataclass
class Losing:
    """A device of which the next `left` replies are lost."""

    left: int = 0

    def habit(self, _: object, answer: Answer) -> Answer:
        def handle(pdu: bytes, now_s: float) -> bytes | None:
            reply = answer(pdu, now_s)
            if not self.left:
                return reply
            self.left -= 1
            return None

        return handle


@pytest.mark.parametrize("owed", [1, 2])
@virtually
async def test_as_many_refusals_of_vb00_as_are_owed_start_nothing(owed: int) -> None:
    """They are the SSW-07's; the SSW-06 that has come since answers the question after them."""
    unanswered = at_first(owed, VB00.__eq__, code=None)
    late = at_first(owed, VB00.__eq__, code=ExceptionCode.ILLEGAL_DATA_ADDRESS)
    async with one_starter(device("ssw07", 0, as_printed)) as here:
        await asyncio.sleep(40.0)
        here.unit.handle = unanswered(here.unit, here.unit.handle)
        here.submit("start", "s1")
        await asyncio.sleep(5.0)
        here.submit("stop", "p1")
        await asyncio.sleep(10.0)
        here.bus.remove(here.unit)
        here.bus.add(device("ssw06", 4, late))
        here.bus.transcript.clear()
        here.submit("start", "s2")
        await asyncio.sleep(30.0)

        assert here.sink.final("s2").phase is Phase.REJECTED
        assert not [pdu for pdu in here.requests() if pdu[0] in (5, 6, 15, 16)]


@virtually
async def test_one_refusal_that_another_device_has_left_behind_starts_nothing() -> None:
    losing = Losing()
    late = at_first(1, VB00.__eq__, code=ExceptionCode.ILLEGAL_DATA_ADDRESS)
    async with one_starter(device("ssw07", 0, losing.habit)) as here:
        await asyncio.sleep(40.0)
        losing.left = 1
        await asyncio.sleep(1.5)
        here.bus.remove(here.unit)
        here.bus.add(device("ssw06", 4, late))
        here.bus.transcript.clear()
        here.submit("start", "s1")
        await asyncio.sleep(30.0)

        assert here.sink.final("s1").phase is Phase.REJECTED
        assert here.requests().count(VB00) >= 2
        assert not [pdu for pdu in here.requests() if pdu[0] in (5, 6, 15, 16)]


@virtually
async def test_a_name_that_another_device_has_left_behind_proves_nothing() -> None:
    """The SSW-07's reply to FC43, owed since its return, comes instead of the SSW-06's, whose VB00 is 15."""
    said = device("ssw07", 0, as_printed).handle(bytes.fromhex("2B 0E 01 00"), 0.0)
    left = [1]

    def late(_: object, answer: Answer) -> Answer:
        def handle(pdu: bytes, now_s: float) -> bytes | None:
            is_late = is_fc43(pdu) and left[0] > 0
            left[0] -= is_late
            return said if is_late else answer(pdu, now_s)

        return handle

    async with one_starter(device("ssw07", 0, as_printed)) as here:
        await asyncio.sleep(40.0)
        right = here.unit
        here.bus.remove(right)
        await asyncio.sleep(4.0)
        right.handle = at_first(1, is_fc43, code=None)(right, right.handle)
        here.bus.add(right)
        await asyncio.sleep(16.0)
        here.bus.remove(right)
        here.bus.add(device("ssw06", 4, late))
        await asyncio.sleep(40.0)
        here.submit("start", "s1")
        await asyncio.sleep(30.0)

        assert here.sink.final("s1").phase is Phase.REJECTED
        assert left == [0]
