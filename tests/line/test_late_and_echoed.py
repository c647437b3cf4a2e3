"""What is on the line beside the reply: echoes, late replies, noise."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterable

import pytest

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Silent
from gateway.modbus import adu
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister, WriteRegisters
from tests.line.fakes import (
    DELAY_S,
    RESPONSE_TIME_S,
    TIMING,
    FakePort,
    Said,
    Units,
    nobody,
    reply_pdu,
    transactor,
    words_of,
)
from tests.line.one_request import READ, READ_ADU, REPLY, told
from tests.virtual_time import run_virtually


@pytest.mark.parametrize("size", [None, 1, 3])
def test_an_echoing_adapter_is_seen_through(size: int | None) -> None:
    async def scenario() -> list[Outcome]:
        port = FakePort(Units({1}, in_chunks_of=size), has_echo=True)
        line = transactor(port)
        write = WriteRegister(7, 8)
        requests: list[tuple[int, Request]] = [(1, READ), (1, write), (2, write), (2, READ), (1, READ)]
        return [await line.transact(unit, it, response_time_s=RESPONSE_TIME_S) for unit, it in requests]

    read, write, unheard_write, unheard_read, read_again = run_virtually(scenario())

    assert isinstance(read, Answered)
    assert read.response_time_s == pytest.approx(DELAY_S)
    assert isinstance(write, Answered)
    assert unheard_write == unheard_read == Silent()  # the echo is no acknowledgement
    assert isinstance(read_again, Answered)


def test_an_echo_in_one_chunk_with_the_reply_is_set_aside() -> None:
    assert isinstance(told(Said(READ_ADU + REPLY)), Answered)
    assert told(Said(READ_ADU)) == Silent()
    assert isinstance(told(Said(READ_ADU[:5])), Garbled)


def test_two_copies_of_a_write_teach_that_the_line_echoes() -> None:
    write = WriteRegister(7, 8)

    async def scenario() -> list[Outcome]:
        port = FakePort(lambda frame: [Said(frame + frame, 0.0)])
        line = transactor(port)
        first = await line.transact(1, write, response_time_s=RESPONSE_TIME_S)
        port.answer = lambda frame: [Said(frame, 0.0)]
        return [first, await line.transact(1, write, response_time_s=RESPONSE_TIME_S)]

    first, second = run_virtually(scenario())

    assert isinstance(first, Answered)
    assert second == Silent()


def test_a_line_that_echoes_no_more_acknowledges_writes_again() -> None:
    async def scenario() -> Outcome:
        port = FakePort(Units({1}), has_echo=True)
        line = transactor(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        port.has_echo = False
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        return await line.transact(1, WriteRegister(7, 8), response_time_s=RESPONSE_TIME_S)

    assert isinstance(run_virtually(scenario()), Answered)


def test_after_silence_the_next_request_waits_for_a_late_reply_to_be_over() -> None:
    async def scenario(late_s: float | None) -> float:
        port = FakePort(nobody if late_s is None else lambda frame: [Said(REPLY, late_s)])
        line = transactor(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        silent_s = asyncio.get_running_loop().time()
        port.answer = nobody
        await line.transact(2, READ, response_time_s=RESPONSE_TIME_S)
        return port.sent[1][0] - silent_s

    assert run_virtually(scenario(None)) == pytest.approx(RESPONSE_TIME_S)
    waited_s = run_virtually(scenario(RESPONSE_TIME_S + 0.021))  # it ends 1 ms after the deadline
    assert waited_s == pytest.approx(0.001 + TIMING.silence_s)


def test_noise_does_not_end_the_wait_for_a_late_reply() -> None:
    async def scenario() -> float:
        port = FakePort(nobody)
        line = transactor(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        silent_s = asyncio.get_running_loop().time()
        port.say(Said(b"\x00\x00", 0.001))
        await line.transact(2, READ, response_time_s=RESPONSE_TIME_S)
        return port.sent[1][0] - silent_s

    assert run_virtually(scenario()) == pytest.approx(RESPONSE_TIME_S)


def test_the_same_unit_is_read_again_only_when_three_deadlines_have_passed() -> None:
    async def scenario(request: Request) -> float:
        port = FakePort(nobody)
        line = transactor(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        await line.transact(1, request, response_time_s=RESPONSE_TIME_S)
        return port.sent[1][0] - port.sent[0][0] - TIMING.wire_s(len(READ_ADU))

    deadline_s = RESPONSE_TIME_S + TIMING.wire_s(len(REPLY)) + 0.02

    late_s = 3 * deadline_s + TIMING.wire_s(len(REPLY)) + 0.02  # one that began at the last moment is over
    assert run_virtually(scenario(READ)) == pytest.approx(late_s)
    assert run_virtually(scenario(WriteRegister(3, 0))) == pytest.approx(deadline_s + RESPONSE_TIME_S)


def test_a_late_reply_to_another_unit_is_garbled_and_the_true_one_not_taken_for_the_next() -> None:
    async def scenario() -> list[Outcome]:
        port = FakePort(Units({1}))
        line = transactor(port)
        port.answer = lambda frame: [
            Said(adu.encode(2, READ.encode_reply((9, 9, 9, 9))), 0.0),
            Said(REPLY, 0.015),
        ]
        first = await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        port.answer = Units({1})
        return [first, await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)]

    first, second = run_virtually(scenario())

    assert isinstance(first, Garbled)
    assert isinstance(second, Answered)
    assert second.value == words_of(READ)


def test_late_replies_of_the_same_shape_are_never_taken_for_an_answer() -> None:
    chance = random.Random(19)

    async def scenario() -> tuple[int, int, int]:
        answered = late = wrong = 0

        def answer(frame: bytes) -> Iterable[Said]:
            nonlocal late
            unit, pdu = adu.decode(frame)
            is_late = chance.random() < 0.05
            late += is_late
            deadline_s = RESPONSE_TIME_S + 0.02 + TIMING.wire_s(13)
            delay_s = (
                chance.uniform(0.9, 2.8) * deadline_s if is_late else chance.uniform(0.0, RESPONSE_TIME_S)
            )
            return [Said(adu.encode(unit, reply_pdu(pdu)), delay_s)]

        line = transactor(FakePort(answer))
        for _ in range(20_000):
            request = ReadHoldingRegisters(chance.randrange(1000), 4)
            outcome = await line.transact(chance.randrange(1, 4), request, response_time_s=RESPONSE_TIME_S)
            if isinstance(outcome, Answered):
                answered += 1
                wrong += outcome.value != words_of(request)
        return answered, late, wrong

    answered, late, wrong = run_virtually(scenario())

    assert wrong == 0
    assert late > 900
    assert answered > 18_000


def test_a_write_of_many_registers_also_waits_for_its_units_late_reply() -> None:
    async def scenario() -> Outcome:
        port = FakePort(lambda frame: [Said(adu.encode(1, reply_pdu(adu.decode(frame).pdu)), 0.070)])
        line = transactor(port)
        await line.transact(1, WriteRegisters(5, (1, 2)), response_time_s=RESPONSE_TIME_S)
        port.answer = nobody
        return await line.transact(1, WriteRegisters(5, (3, 4)), response_time_s=RESPONSE_TIME_S)

    assert run_virtually(scenario()) == Silent()
