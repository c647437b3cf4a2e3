"""One request and what comes after it, in words on the wires: which outcome it has, and when."""

from __future__ import annotations

import asyncio
import random

import pytest

from gateway.line.events import Trace
from gateway.line.rtu.forms import EncodedRequest
from gateway.line.rtu.master import RtuMaster
from gateway.line.rtu.silence import BABBLE_LIMIT_S
from gateway.line.rtu.transaction import TOO_LATE, Answered, Garbled, Outcome, Silent
from gateway.modbus import adu
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from gateway.sim.bus.port import SimulatedPort
from tests.line.line_rig import DELAY_S, READ, RESPONSE_TIME_S, TIMING, InPlace, Wires
from tests.virtual_time import run_virtually

REPLY = adu.encode(1, READ.encode_reply((1, 2)))
WRITE = WriteRegister(314, 8)
ASKED_S = TIMING.wire_s(8)


class Asking:
    """A master on wires with one unit, unit 2 is not there."""

    def __init__(self, timing: LineTiming = TIMING, *, chunk_bytes: int | None = None) -> None:
        self.wires = Wires(timing=timing)
        self.wires.bus.chunk_bytes = chunk_bytes
        self.master = RtuMaster(timing, note_frame=Trace("line").note)
        self.open()

    def open(self) -> None:
        self.master.use(self.wires.bus.open(self.wires.timing))

    async def ask(self, request: Request, unit: int = 1) -> Outcome:
        return await self.master.transact(unit, request, response_time_s=RESPONSE_TIME_S)


@pytest.mark.parametrize("size", [None, 1, 2, 7])
def test_a_reply_is_answered_with_its_value_and_times_in_any_chunking(size: int | None) -> None:
    async def scenario() -> tuple[Outcome, float]:
        asking = Asking(chunk_bytes=size)
        return await asking.ask(READ), asking.wires.sent[0][0]

    outcome, at_s = run_virtually(scenario())

    assert isinstance(outcome, Answered)
    assert outcome.value == (1, 2)
    assert outcome.response_time_s == pytest.approx(DELAY_S)
    assert outcome.at_s == pytest.approx(at_s + ASKED_S + DELAY_S + TIMING.wire_s(len(REPLY)))


def test_no_reply_is_silent_after_the_response_time_the_reply_and_the_allowance() -> None:
    async def scenario() -> tuple[Outcome, float]:
        asking = Asking()
        outcome = await asking.ask(READ, unit=2)
        return outcome, asyncio.get_running_loop().time() - asking.wires.sent[0][0]

    outcome, waited_s = run_virtually(scenario())

    assert outcome == Silent()
    assert waited_s == pytest.approx(ASKED_S + TIMING.wire_s(len(REPLY)) + RESPONSE_TIME_S + 0.02)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (REPLY[:-1] + bytes((REPLY[-1] ^ 1,)), "CRC"),
        (REPLY[:-3], "CRC"),
        (b"\x01", "1 bytes"),
        (adu.encode(2, REPLY[1:-2]), "unit 2"),
        (adu.encode(1, b"\x04" + REPLY[2:-2]), "function 4"),
        (adu.encode(1, b"\x84\x02"), "function 132"),
        (adu.encode(1, ReadHoldingRegisters(2, 1).encode_reply((1,))), "not the reply"),
        (adu.encode(1, b"\x03\x05" + bytes(4)), "another length"),  # says 5 bytes, has 4
        (b"\x00\x03" + REPLY[2:], "CRC"),
    ],
)
def test_what_does_not_answer_is_garbled_and_named(frame: bytes, reason: str) -> None:
    async def scenario() -> Outcome:
        asking = Asking()
        asking.wires.bus.impair(1, InPlace(frame))
        return await asking.ask(READ)

    outcome = run_virtually(scenario())

    assert isinstance(outcome, Garbled)
    assert reason in outcome.reason
    assert outcome.is_sent


@pytest.mark.parametrize("baud", [9600, 19200, 38400, 57600])
@pytest.mark.parametrize("size", [None, 1])
def test_no_request_starts_before_the_silence_is_over_and_none_long_after(
    baud: int, size: int | None
) -> None:
    timing, chance = LineTiming(baud, Framing.parse("8E1")), random.Random(baud)

    async def scenario() -> list[float]:
        asking = Asking(timing, chunk_bytes=size)
        bus = asking.wires.bus
        for _ in range(200):
            bus.units[0].response_delay_s = lambda _: chance.uniform(0.0, 0.03)  # some too late
            if chance.random() < 0.1:
                asyncio.get_running_loop().call_later(
                    chance.uniform(0.0, 0.02), bus._transmit, 99, chance.randbytes(5)
                )
            await asking.ask(ReadHoldingRegisters(2, chance.randrange(1, 3)), unit=chance.choice((1, 1, 2)))
        assert {each.kind for each in bus.violations} <= {"collision"}  # of what came without a request
        return asking.wires.silences_s()

    silences_s = run_virtually(scenario())

    assert min(each for each in silences_s if each > 0) == pytest.approx(timing.silence_s, abs=1e-6)


def test_a_line_that_never_becomes_quiet_is_given_up_unsent() -> None:
    async def scenario() -> tuple[Outcome, list[tuple[float, bytes]], float]:
        asking = Asking()
        asking.wires.bus.inbox.put(b"\x55" * 4000, start_s=0.0, size=1)
        outcome = await asking.ask(READ)
        return outcome, asking.wires.sent, asyncio.get_running_loop().time()

    outcome, sent, given_up_s = run_virtually(scenario())

    assert outcome == Garbled("the line is never quiet", b"\x55" * 256, is_sent=False)
    assert given_up_s == pytest.approx(BABBLE_LIMIT_S, abs=0.01)
    assert sent == []


@pytest.mark.parametrize("size", [None, 1, 3])
def test_an_echo_is_seen_through_and_is_no_acknowledgement(size: int | None) -> None:
    async def scenario() -> list[str]:
        asking = Asking(chunk_bytes=size)
        asking.wires.echo()
        found = [await asking.ask(*each) for each in ((READ,), (WRITE,), (WRITE, 2), (READ, 2), (READ,))]
        asking.wires.lose("u1")
        asking.wires.unplug()
        asking.wires.plug()
        asking.open()  # what was found of the adapter outlives the port
        found.append(await asking.ask(WRITE))
        asking.wires.heal("u1")
        asking.wires.bus.has_echo = False
        found += [await asking.ask(each) for each in (READ, WRITE)]
        return [type(each).__name__ for each in found]

    assert run_virtually(scenario()) == (
        ["Answered", "Answered", "Silent", "Silent", "Answered", "Silent", "Answered", "Answered"]
    )


class HoldingPort(SimulatedPort):
    """A port in whose last wait before the write the process is stopped."""

    stopped_s = 0.0

    def hold(self) -> None:
        self.stopped_s = 7.0


@pytest.mark.parametrize(("until_s", "is_sent"), [(5.0, False), (10.0, True)])
def test_a_frame_that_has_become_too_late_in_the_last_wait_before_it_is_not_sent(
    until_s: float, is_sent: bool
) -> None:
    async def scenario() -> tuple[Outcome, bool, int]:
        wires, loop = Wires(), asyncio.get_running_loop()
        port = HoldingPort(wires.bus, TIMING)
        master = RtuMaster(TIMING, note_frame=Trace("line").note)
        master.use(port, time=lambda: loop.time() + port.stopped_s)
        await asyncio.sleep(0.1)
        encoded = EncodedRequest.of(1, READ)
        outcome = await master.send(encoded, response_time_s=RESPONSE_TIME_S, until_s=until_s)
        return outcome, master.is_on_wire, len(wires.sent)

    outcome, is_on_wire, count = run_virtually(scenario())

    assert (outcome == Silent(TOO_LATE, is_sent=False)) is not is_sent
    assert not is_on_wire
    assert count == int(is_sent)


def test_a_late_reply_and_a_reply_in_one_chunk_are_judged_one_by_one() -> None:
    late = adu.encode(1, ReadHoldingRegisters(2, 1).encode_reply((7,)))

    async def scenario() -> tuple[list[Outcome], RtuMaster]:
        asking = Asking()
        asking.wires.lose("u1", count=1)
        found = [await asking.ask(ReadHoldingRegisters(2, 1))]
        asking.wires.bus.impair(1, InPlace(late + REPLY))
        return [*found, await asking.ask(READ)], asking.master

    (missed, answered), master = run_virtually(scenario())

    assert missed == Silent()
    assert isinstance(answered, Answered)
    assert answered.value == (1, 2)
    assert master.forms.outstanding.is_in_step(1)
    assert master.strays.late_units == [1]
