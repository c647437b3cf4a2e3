"""What is on the line beside the reply: echoes, late replies, noise."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterable

import pytest

from gateway.line.rtu.late_replies import COPY_S, expected_shape
from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
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
    master,
    no_reply,
    reply_pdu,
    words_of,
)
from tests.line.one_request import READ, READ_ADU, REPLY, outcome_after
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


def test_an_echo_in_one_chunk_with_the_reply_is_set_aside() -> None:
    assert isinstance(outcome_after(Said(READ_ADU + REPLY)), Answered)
    assert outcome_after(Said(READ_ADU)) == Silent()
    assert isinstance(outcome_after(Said(READ_ADU[:5])), Garbled)


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


def test_after_silence_the_next_request_waits_for_a_late_reply_to_be_over() -> None:
    async def scenario(late_s: float | None) -> float:
        port = FakePort(no_reply if late_s is None else lambda frame: [Said(REPLY, late_s)])
        line = master(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        silent_s = asyncio.get_running_loop().time()
        port.answer = no_reply
        await line.transact(2, READ, response_time_s=RESPONSE_TIME_S)
        return port.sent[1][0] - silent_s

    assert run_virtually(scenario(None)) == pytest.approx(RESPONSE_TIME_S)
    waited_s = run_virtually(scenario(RESPONSE_TIME_S + 0.021))  # it ends 1 ms after the deadline
    assert waited_s == pytest.approx(0.001 + TIMING.silence_s)


def test_noise_does_not_end_the_wait_for_a_late_reply() -> None:
    async def scenario() -> float:
        port = FakePort(no_reply)
        line = master(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        silent_s = asyncio.get_running_loop().time()
        port.say(Said(b"\x00\x00", 0.001))
        await line.transact(2, READ, response_time_s=RESPONSE_TIME_S)
        return port.sent[1][0] - silent_s

    assert run_virtually(scenario()) == pytest.approx(RESPONSE_TIME_S)


def test_one_answer_of_a_shape_that_is_owed_does_not_count_two_equal_ones_do() -> None:
    async def scenario() -> tuple[Outcome, list[float]]:
        port = FakePort(no_reply)
        line = master(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        port.answer = Units({1})
        outcome = await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        return outcome, [at_s for at_s, _ in port.sent]

    outcome, sent_s = run_virtually(scenario())

    assert isinstance(outcome, Answered)
    assert len(sent_s) == 3
    assert sent_s[2] - sent_s[1] > COPY_S


def test_another_shape_and_a_write_go_at_once_to_a_unit_that_owes_a_reply() -> None:
    async def scenario(request: Request) -> float:
        port = FakePort(no_reply)
        line = master(port)
        await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)
        await line.transact(1, request, response_time_s=RESPONSE_TIME_S)
        return port.sent[1][0] - port.sent[0][0] - TIMING.wire_s(len(READ_ADU))

    deadline_s = RESPONSE_TIME_S + TIMING.wire_s(len(REPLY)) + 0.02

    for other in (WriteRegister(3, 0), ReadHoldingRegisters(READ.address, READ.count + 1)):
        assert run_virtually(scenario(other)) == pytest.approx(deadline_s + RESPONSE_TIME_S)


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

        line = master(FakePort(answer))
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


def test_several_late_replies_at_once_are_all_known_for_what_they_are() -> None:
    shapes = [ReadHoldingRegisters(0, count) for count in (4, 5, 6)]

    async def scenario() -> list[float]:
        port = FakePort(no_reply)
        line = master(port)
        for request in shapes:
            await line.transact(1, request, response_time_s=RESPONSE_TIME_S)
        burst = b"".join(adu.encode(1, request.encode_reply(words_of(request))) for request in shapes)
        port.say(Said(burst, 0.5))
        began_s = asyncio.get_running_loop().time()
        await asyncio.sleep(0.6)
        port.answer = Units({1})
        for request in shapes:
            assert isinstance(await line.transact(1, request, response_time_s=RESPONSE_TIME_S), Answered)
        return [at_s - began_s for at_s, _ in port.sent[len(shapes) :]]

    assert run_virtually(scenario())[-1] < 1.0  # nothing is owed any more, so nothing had to wait


def test_a_copy_just_before_the_next_reply_is_not_taken_for_what_was_owed() -> None:
    longer = ReadHoldingRegisters(0x0200, 5)
    reply = adu.encode(1, longer.encode_reply((1, 2, 3, 4, 5)))
    said = iter([[Said(REPLY)], [Said(REPLY + reply, delay_s=0.013)]])

    async def scenario() -> tuple[list[Outcome], bool]:
        line = master(FakePort(lambda frame: next(said)))
        outcomes = [await line.transact(1, READ, response_time_s=RESPONSE_TIME_S)]
        now_s = asyncio.get_running_loop().time()
        line.late.note_unanswered(1, expected_shape(READ), now_s - 5.0, now_s - 4.9)
        outcomes.append(await line.transact(1, longer, response_time_s=RESPONSE_TIME_S))
        return outcomes, line.late.owes(1)

    outcomes, is_owed = run_virtually(scenario())

    assert all(isinstance(outcome, Answered) for outcome in outcomes)
    assert is_owed


def test_a_copy_that_began_before_the_request_during_which_it_ends_is_a_copy() -> None:
    longer, longest = ReadHoldingRegisters(0x0200, 5), ReadHoldingRegisters(0x0200, 6)
    wire_s = TIMING.wire_s(len(REPLY))
    late = Said(REPLY, delay_s=0.0)
    copy = Said(REPLY, delay_s=wire_s + COPY_S - 0.001)
    own = Said(adu.encode(1, reply_pdu(longer.encode())), delay_s=wire_s + 0.001, in_chunks_of=1)

    async def scenario() -> tuple[list[Outcome], int]:
        loop = asyncio.get_running_loop()
        port = FakePort(lambda frame: [late, copy, own])
        line = master(port)
        for before_s in (5.0, 4.0):
            asked_s = loop.time() - before_s
            line.late.note_unanswered(1, expected_shape(READ), asked_s, asked_s + 0.1)
        outcomes = [await line.transact(1, longer, response_time_s=RESPONSE_TIME_S)]
        port.answer = Units({1})
        await asyncio.sleep(port.sent[0][0] + TIMING.wire_s(8) + copy.delay_s + 0.004 - loop.time())
        outcomes.append(await line.transact(1, longest, response_time_s=RESPONSE_TIME_S))
        return outcomes, line.late.came_late[1]

    outcomes, came_late = run_virtually(scenario())

    assert all(isinstance(outcome, Answered) for outcome in outcomes)
    assert came_late == 1  # the other is still owed
