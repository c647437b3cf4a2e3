"""What a line asks of starters that may still send an earlier reply."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from dataclasses import replace
from operator import itemgetter

from gateway.line.job import Lane
from gateway.line.outcome import Answered, Outcome
from gateway.line.rtu.late_replies import COPY_S
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.server import decode_request
from tests.line.fakes import LIFE, RESPONSE_TIME_S, Rig, Said, Units, nobody, poll, reply_pdu, until, words_of
from tests.virtual_time import run_virtually

READ = ReadHoldingRegisters(0, 10)


def counts(rig: Rig) -> list[int]:
    return [decode_request(adu.decode(frame).pdu).count for _, frame in rig.port.sent]


def test_after_a_silence_a_starter_is_asked_for_life_and_then_in_another_form() -> None:
    rig = Rig(Units({1}), [poll("a")])

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(0.5)
            rig.port.answer = nobody
            await asyncio.sleep(1.0)
            rig.port.answer = Units({1})
            await asyncio.sleep(3.0)

    run_virtually(scenario())

    asked = counts(rig)
    assert asked[:2] == [READ.count, READ.count]
    assert set(asked[2:]) == {LIFE.count, READ.count + 1}  # the first form is owed
    answers = [outcome for outcome in rig.listener.outcomes("a") if isinstance(outcome, Answered)]
    assert len(answers) >= 3
    assert all(answer.value == words_of(READ) for answer in answers)


def test_a_job_is_asked_in_another_form_too() -> None:
    rig = Rig(Units({1}), [poll("a", every_s=60.0, count=3)])

    async def scenario() -> Outcome:
        async with rig:
            await asyncio.sleep(1.0)
            rig.port.answer = nobody
            await rig.transact(1, READ, Lane.READ_BACK)
            rig.port.answer = Units({1})
            return await rig.transact(1, READ, Lane.READ_BACK)

    outcome = run_virtually(scenario())

    assert isinstance(outcome, Answered)
    assert outcome.value == words_of(READ)
    assert counts(rig)[-3:] == [READ.count, LIFE.count, READ.count + 1]


def test_a_job_that_has_no_other_form_is_read_twice_and_holds_up_nobody() -> None:
    rig = Rig(Units({1, 2}), [poll("b", unit=2)])

    async def scenario() -> float:
        async with rig:
            rig.port.answer = lambda frame: Units({2})(frame)
            await rig.transact(1, READ, Lane.READ_BACK)
            rig.port.answer = Units({1, 2})
            began_s = asyncio.get_running_loop().time()
            assert isinstance(await rig.transact(1, READ, Lane.READ_BACK), Answered)
            return asyncio.get_running_loop().time() - began_s

    took_s = run_virtually(scenario())

    asked_s = [at_s for at_s, frame in rig.port.sent if frame[0] == 1]
    assert len(asked_s) == 3
    assert asked_s[2] - asked_s[1] > COPY_S
    assert took_s < 0.2
    assert len(rig.listener.outcomes("b")) >= 1


def test_what_is_read_in_two_requests_is_one_answer() -> None:
    halves = (ReadHoldingRegisters(0, 6), ReadHoldingRegisters(6, 4))
    two = replace(poll("a"), alternates=((halves, itemgetter(slice(10))),))
    rig = Rig(Units({1}), [two])

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(0.5)
            rig.port.answer = nobody
            await asyncio.sleep(0.6)
            rig.port.answer = Units({1})
            await asyncio.sleep(2.0)

    run_virtually(scenario())

    assert [count for count in counts(rig) if count in (4, 6)][:2] == [6, 4]
    answers = [outcome for outcome in rig.listener.outcomes("a") if isinstance(outcome, Answered)]
    assert len(answers) >= 2
    assert all(answer.value == words_of(READ) for answer in answers)


def test_on_a_disturbed_line_a_change_of_state_is_told_after_two_readings_of_different_shapes() -> None:
    decisive = replace(poll("a"), decisive=itemgetter(0))
    state = 0

    def answer(frame: bytes) -> Iterable[Said]:
        unit, pdu = adu.decode(frame)
        request = decode_request(pdu)
        return [Said(adu.encode(unit, request.encode_reply((state,) * request.count)))]

    rig = Rig(answer, [decisive])

    async def scenario() -> None:
        nonlocal state
        async with rig:
            await asyncio.sleep(0.5)
            rig.port.say(Said(adu.encode(1, READ.encode_reply((9,) * 10)), 0.0))  # one that came late
            await asyncio.sleep(2.0)
            state = 1
            await asyncio.sleep(1.2)

    run_virtually(scenario())

    told = [outcome.value[0] for outcome in rig.listener.outcomes("a") if isinstance(outcome, Answered)]
    assert told[-1] == 1
    assert told == sorted(told)
    assert len(rig.port.sent) == len(told) + 1
    assert counts(rig)[-1] != counts(rig)[-2]
    assert rig.port.sent[-1][0] - rig.port.sent[-2][0] < 0.1  # at once


def test_what_is_owed_outlives_the_port() -> None:
    rig = Rig(nobody, [])

    def changed(frame: bytes) -> Iterable[Said]:
        return [Said(adu.encode(1, READ.encode_reply((9,) * READ.count)))]

    async def scenario() -> Outcome:
        async with rig:
            await rig.transact(1, READ, Lane.READ_BACK)
            rig.port.hang_up()
            await asyncio.sleep(3.0)
            late = adu.encode(1, reply_pdu(adu.decode(rig.opener.ports[0].sent[0][1]).pdu))
            rig.port.answer = lambda frame: [Said(late)]
            asked = rig.client.transact(
                1, READ, response_time_s=RESPONSE_TIME_S, lane=Lane.READ_BACK, until_s=10.0
            )
            await until(lambda: len(rig.port.sent) == 1)
            rig.port.answer = changed
            return await asked

    outcome = run_virtually(scenario())

    assert isinstance(outcome, Answered)
    assert outcome.value == (9,) * READ.count
    assert len(rig.port.sent) == 4  # the late one; another that differs; two that are equal
