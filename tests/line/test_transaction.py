from __future__ import annotations

import asyncio
import random

import pytest

from gateway.line.events import Trace
from gateway.line.rtu.forms import EncodedRequest
from gateway.line.rtu.master import RtuMaster
from gateway.line.rtu.outcome import TOO_LATE, Answered, Garbled, Outcome, Silent
from gateway.line.rtu.silence import BABBLE_LIMIT_S
from gateway.modbus import adu
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import (
    DELAY_S,
    RESPONSE_TIME_S,
    TIMING,
    FakePort,
    Said,
    Units,
    ask,
    master,
    no_reply,
)
from tests.virtual_time import run_virtually

READ = ReadHoldingRegisters(0x0100, 4)
READ_ADU = adu.encode(1, READ.encode())
REPLY = adu.encode(1, READ.encode_reply((1, 2, 3, 4)))
LAST_REPLY_S = DELAY_S + TIMING.wire_s(len(REPLY))


def outcome_after(*said: Said) -> Outcome:
    """Return what becomes of READ when this comes after it."""

    async def scenario() -> Outcome:
        return await ask(FakePort(lambda frame: said), READ)

    return run_virtually(scenario())


@pytest.mark.parametrize("size", [None, 1, 2, 7])
def test_a_reply_is_answered_with_its_value_and_times_in_any_chunking(size: int | None) -> None:
    async def scenario() -> tuple[Outcome, float]:
        port = FakePort(lambda frame: [Said(REPLY, in_chunks_of=size)])
        outcome = await ask(port, READ)
        return outcome, port.sent[0][0] + TIMING.wire_s(len(READ_ADU))

    outcome, sent_end_s = run_virtually(scenario())

    assert isinstance(outcome, Answered)
    assert outcome.value == (1, 2, 3, 4)
    assert outcome.response_time_s == pytest.approx(DELAY_S)
    assert outcome.at_s == pytest.approx(sent_end_s + LAST_REPLY_S)


def test_no_reply_is_silent_after_the_response_time_the_reply_and_the_allowance() -> None:
    async def scenario() -> tuple[Outcome, float]:
        port = FakePort(no_reply)
        outcome = await ask(port, READ)
        return outcome, asyncio.get_running_loop().time() - port.sent[0][0]

    outcome, waited_s = run_virtually(scenario())

    assert outcome == Silent()
    wire_s = TIMING.wire_s(len(READ_ADU) + len(REPLY))
    assert waited_s == pytest.approx(wire_s + RESPONSE_TIME_S + 0.02)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (REPLY[:-1] + bytes((REPLY[-1] ^ 1,)), "CRC"),
        (REPLY[:-3], "CRC"),
        (b"\x01", "1 bytes"),
        (adu.encode(2, READ.encode_reply((1, 2, 3, 4))), "unit 2"),
        (adu.encode(1, b"\x04" + READ.encode_reply((1, 2, 3, 4))[1:]), "function 4"),
        (adu.encode(1, b"\x84\x02"), "function 132"),
        (adu.encode(1, ReadHoldingRegisters(0, 3).encode_reply((1, 2, 3))), "not the reply"),
        (adu.encode(1, b"\x03\x09" + bytes(8)), "another length"),  # says 9 bytes, has 8
        (b"\x00\x03" + REPLY[2:], "CRC"),
    ],
)
def test_what_does_not_answer_is_garbled_and_named(frame: bytes, reason: str) -> None:
    outcome = outcome_after(Said(frame))

    assert isinstance(outcome, Garbled)
    assert reason in outcome.reason
    assert outcome.is_sent


@pytest.mark.parametrize("baud", [9600, 19200, 38400, 57600])
@pytest.mark.parametrize("size", [None, 1])
def test_no_request_starts_before_the_silence_is_over(baud: int, size: int | None) -> None:
    timing = LineTiming(baud, Framing.parse("8E1"))
    chance = random.Random(baud)

    async def scenario() -> FakePort:
        port = FakePort(Units({1, 2, 3}, in_chunks_of=size), timing)
        line = master(port)
        for _ in range(2000 if size is None else 200):
            units = Units({1, 2, 3}, chance.uniform(0.0, 0.03), size)  # some too late
            port.answer = units
            if chance.random() < 0.1:
                port.say(Said(chance.randbytes(5), chance.uniform(0.0, 0.02), in_chunks_of=1))
            request = ReadHoldingRegisters(chance.randrange(1000), chance.randrange(1, 20))
            await line.transact(chance.randrange(1, 5), request, response_time_s=RESPONSE_TIME_S)
        return port

    port = run_virtually(scenario())

    assert port.shortest_silence_s >= timing.silence_s - 1e-9
    assert port.shortest_silence_s < timing.silence_s + 1e-6


def test_a_line_that_never_becomes_quiet_is_given_up_unsent() -> None:
    async def scenario() -> tuple[Outcome, FakePort, float]:
        port = FakePort(no_reply)
        port.say(Said(b"\x55" * 2000, 0.0, in_chunks_of=1, gap_s=0.001))
        return await ask(port, READ), port, asyncio.get_running_loop().time()

    outcome, port, given_up_s = run_virtually(scenario())

    assert isinstance(outcome, Garbled)
    assert not outcome.is_sent
    assert outcome.received == b"\x55" * 256
    assert given_up_s == pytest.approx(BABBLE_LIMIT_S, abs=0.01)
    assert port.sent == []


@pytest.mark.parametrize("size", [None, 1, 3])
def test_an_echoing_adapter_is_seen_through(size: int | None) -> None:
    write = WriteRegister(7, 8)
    requests: list[tuple[int, Request]] = [(1, READ), (1, write), (2, write), (2, READ), (1, READ)]

    def answer(frame: bytes) -> list[Said]:
        return [Said(frame, -TIMING.wire_s(len(frame))), *Units({1}, in_chunks_of=size)(frame)]

    async def scenario() -> list[Outcome]:
        line = master(FakePort(answer))
        return [await line.transact(unit, it, response_time_s=RESPONSE_TIME_S) for unit, it in requests]

    read, written, unheard_write, unheard_read, read_again = run_virtually(scenario())

    assert isinstance(read, Answered)
    assert read.response_time_s == pytest.approx(DELAY_S)
    assert isinstance(written, Answered)
    assert unheard_write == unheard_read == Silent()  # the echo is no acknowledgement
    assert isinstance(read_again, Answered)


def test_the_echo_that_was_found_is_no_acknowledgement_when_the_port_was_opened_again() -> None:
    def only_echo(frame: bytes) -> list[Said]:
        return [Said(frame, -TIMING.wire_s(len(frame)))]

    async def scenario() -> Outcome:
        units = Units({1})
        line = master(FakePort(lambda frame: [*only_echo(frame), *units(frame)]))
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        line.use(FakePort(only_echo))
        return await line.transact(1, WriteRegister(7, 8), response_time_s=RESPONSE_TIME_S)

    assert run_virtually(scenario()) == Silent()


def test_a_line_that_echoes_no_more_acknowledges_writes_again() -> None:
    async def scenario() -> Outcome:
        units = Units({1})
        port = FakePort(lambda frame: [Said(frame, -TIMING.wire_s(len(frame))), *units(frame)])
        line = master(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        port.answer = units
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        return await line.transact(1, WriteRegister(7, 8), response_time_s=RESPONSE_TIME_S)

    assert isinstance(run_virtually(scenario()), Answered)


class HoldingPort(FakePort):
    """A port in whose last wait before the write the process is stopped."""

    stopped_s = 0.0

    def hold(self) -> None:
        self.stopped_s = 7.0


@pytest.mark.parametrize(("until_s", "is_sent"), [(5.0, False), (10.0, True)])
def test_a_frame_that_has_become_too_late_in_the_last_wait_before_it_is_not_sent(
    until_s: float, is_sent: bool
) -> None:
    async def scenario() -> tuple[Outcome, bool, int]:
        port = HoldingPort(lambda frame: [Said(REPLY)])
        loop = asyncio.get_running_loop()
        line = RtuMaster(TIMING, note_frame=Trace("line").note)
        line.use(port, time=lambda: loop.time() + port.stopped_s)
        await asyncio.sleep(0.1)
        encoded = EncodedRequest.of(1, READ)
        outcome = await line.send(encoded, response_time_s=RESPONSE_TIME_S, until_s=until_s)
        return outcome, line.is_on_wire, len(port.sent)

    outcome, is_on_wire, count = run_virtually(scenario())

    assert (outcome == Silent(TOO_LATE, is_sent=False)) is not is_sent
    assert not is_on_wire
    assert count == int(is_sent)


def test_a_late_reply_and_a_reply_in_one_chunk_are_judged_one_by_one() -> None:
    first, second = ReadHoldingRegisters(0, 1), ReadHoldingRegisters(0, 2)
    late = adu.encode(1, first.encode_reply((7,)))

    def answer(frame: bytes) -> list[Said]:
        is_first = frame == adu.encode(1, first.encode())
        return [] if is_first else [Said(late + adu.encode(1, second.encode_reply((8, 9))))]

    async def scenario() -> tuple[Outcome, Outcome, RtuMaster]:
        line = master(FakePort(answer))
        missed = await line.transact(1, first, response_time_s=RESPONSE_TIME_S)
        return missed, await line.transact(1, second, response_time_s=RESPONSE_TIME_S), line

    missed, answered, line = run_virtually(scenario())

    assert missed == Silent()
    assert isinstance(answered, Answered)
    assert answered.value == (8, 9)
    assert line.forms.outstanding.is_in_step(1)
    assert line.strays.late_units == [1]
