"""What is on the line beside the reply: echoes, late replies, noise."""

from __future__ import annotations

import pytest

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus import adu
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister, WriteRegisters
from tests.line.fakes import (
    DELAY_S,
    RESPONSE_TIME_S,
    FakePort,
    Said,
    Units,
    master,
    no_reply,
    reply_pdu,
    words_of,
)
from tests.line.one_request import READ
from tests.virtual_time import run_virtually


@pytest.mark.parametrize("size", [None, 1, 3])
def test_an_echoing_adapter_is_seen_through(size: int | None) -> None:
    async def scenario() -> list[Outcome]:
        port = FakePort(Units({1}, in_chunks_of=size), has_echo=True)
        line = master(port)
        write = WriteRegister(7, 8)
        requests: list[tuple[int, Request]] = [(1, READ), (1, write), (2, write), (2, READ), (1, READ)]
        return [await line.transact(unit, it, response_time_s=RESPONSE_TIME_S) for unit, it in requests]

    read, write, unheard_write, unheard_read, read_again = run_virtually(scenario())

    assert isinstance(read, Answered)
    assert read.response_time_s == pytest.approx(DELAY_S)
    assert isinstance(write, Answered)
    assert unheard_write == unheard_read == Silent()  # the echo is no acknowledgement
    assert isinstance(read_again, Answered)


def test_two_copies_of_a_write_teach_that_the_line_echoes() -> None:
    write = WriteRegister(7, 8)

    async def scenario() -> list[Outcome]:
        port = FakePort(lambda frame: [Said(frame + frame, 0.0)])
        line = master(port)
        first = await line.transact(1, write, response_time_s=RESPONSE_TIME_S)
        port.answer = lambda frame: [Said(frame, 0.0)]
        return [first, await line.transact(1, write, response_time_s=RESPONSE_TIME_S)]

    first, second = run_virtually(scenario())

    assert isinstance(first, Answered)
    assert second == Silent()


def test_a_line_that_echoes_no_more_acknowledges_writes_again() -> None:
    async def scenario() -> Outcome:
        port = FakePort(Units({1}), has_echo=True)
        line = master(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        port.has_echo = False
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        return await line.transact(1, WriteRegister(7, 8), response_time_s=RESPONSE_TIME_S)

    assert isinstance(run_virtually(scenario()), Answered)


def test_a_late_reply_of_another_unit_is_set_aside_and_the_true_one_waited_for() -> None:
    async def scenario() -> list[Outcome]:
        port = FakePort(Units({1}))
        line = master(port)
        port.answer = lambda frame: [
            Said(adu.encode(2, READ.encode_reply((9, 9, 9, 9))), 0.0),
            Said(adu.encode(1, READ.encode_reply(words_of(READ))), 0.015),
        ]
        first = await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        port.answer = Units({1})
        return [first, await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)]

    first, second = run_virtually(scenario())

    for outcome in (first, second):
        assert isinstance(outcome, Answered)
        assert outcome.value == words_of(READ)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (WriteRegister(7, 8), WriteRegister(7, 8)),
        (WriteRegisters(5, (1, 2)), WriteRegisters(5, (3, 4))),  # its acknowledgement does not say what
    ],
)
def test_a_late_acknowledgement_does_not_pass_for_that_of_a_later_write(
    first: Request, second: Request
) -> None:
    async def scenario() -> tuple[Outcome, Outcome]:
        port = FakePort(lambda frame: [Said(adu.encode(1, reply_pdu(adu.decode(frame).pdu)), 0.070)])
        line = master(port)
        silent = await line.transact(1, first, response_time_s=RESPONSE_TIME_S)
        port.answer = no_reply
        return silent, await line.transact(1, second, response_time_s=RESPONSE_TIME_S)

    silent, doubted = run_virtually(scenario())

    assert silent == Silent()
    assert isinstance(doubted, Garbled)
    assert "earlier write" in doubted.reason


def test_a_refusal_is_not_believed_while_an_earlier_request_may_be_what_is_refused() -> None:
    other = ReadHoldingRegisters(READ.address, READ.count + 1)

    async def scenario() -> tuple[Outcome, Outcome]:
        port = FakePort(no_reply)
        line = master(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        port.answer = lambda frame: [Said(adu.encode(1, b"\x83\x02"))]
        doubted = await line.transact(1, other, response_time_s=RESPONSE_TIME_S)
        return doubted, await line.transact(1, other, response_time_s=RESPONSE_TIME_S)

    doubted, believed = run_virtually(scenario())

    assert isinstance(doubted, Garbled)
    assert isinstance(believed, Refused)  # once nothing was owed
