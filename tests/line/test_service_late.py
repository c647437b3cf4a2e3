"""What a line asks of starters that may still send an earlier reply."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

from gateway.line.rtu.late_replies import COPY_S, DISTURBED_S
from gateway.line.rtu.outcome import Answered, Outcome
from gateway.line.scheduler.requests import Priority
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.server import decode_request
from tests.line.fakes import RESPONSE_TIME_S, LineRig, Said, Units, no_reply, poll, reply_pdu, until, words_of
from tests.virtual_time import run_virtually

READ = ReadHoldingRegisters(0, 10)


def counts(rig: LineRig) -> list[int]:
    return [decode_request(adu.decode(frame).pdu).count for _, frame in rig.port.sent]


def test_after_a_silence_a_starter_is_asked_in_another_form() -> None:
    rig = LineRig(Units({1}), [poll("a")])

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(0.5)
            rig.port.answer = no_reply
            await asyncio.sleep(1.0)
            rig.port.answer = Units({1})
            await asyncio.sleep(3.0)

    run_virtually(scenario())

    asked = counts(rig)
    assert asked[:2] == [READ.count, READ.count]
    assert asked[2] == READ.count + 1  # the first form is owed
    assert READ.count not in asked[2:]
    answers = [outcome for outcome in rig.listener.outcomes("a") if isinstance(outcome, Answered)]
    assert len(answers) >= 3
    assert all(answer.value == words_of(READ) for answer in answers)


def test_a_job_is_asked_in_another_form_too() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=60.0, count=3)])

    async def scenario() -> Outcome:
        async with rig:
            await asyncio.sleep(1.0)
            rig.port.answer = no_reply
            await rig.transact(1, READ, Priority.READ_BACK)
            rig.port.answer = Units({1})
            return await rig.transact(1, READ, Priority.READ_BACK)

    outcome = run_virtually(scenario())

    assert isinstance(outcome, Answered)
    assert outcome.value == words_of(READ)
    assert counts(rig)[-3:] == [3, READ.count, READ.count + 1]


def test_a_job_that_has_no_other_form_is_read_twice_and_holds_up_no_other() -> None:
    rig = LineRig(Units({1, 2}), [poll("b", unit=2)])

    async def scenario() -> float:
        async with rig:
            rig.port.answer = lambda frame: Units({2})(frame)
            await rig.transact(1, READ, Priority.READ_BACK)
            rig.port.answer = Units({1, 2})
            began_s = asyncio.get_running_loop().time()
            assert isinstance(await rig.transact(1, READ, Priority.READ_BACK), Answered)
            return asyncio.get_running_loop().time() - began_s

    took_s = run_virtually(scenario())

    asked_s = [at_s for at_s, frame in rig.port.sent if frame[0] == 1]
    assert len(asked_s) == 3
    assert asked_s[2] - asked_s[1] > COPY_S
    assert took_s < 0.2
    assert len(rig.listener.outcomes("b")) >= 1


def test_on_a_disturbed_line_two_readings_of_a_state_in_a_row_have_different_shapes() -> None:
    rig = LineRig(
        Units({1}), [replace(poll("a", every_s=0.5), is_urgent=True), poll("b", count=30, every_s=0.5)]
    )

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(0.6)
            rig.port.say(Said(adu.encode(1, READ.encode_reply((9,) * 10)), 0.0))  # one that came late
            await asyncio.sleep(DISTURBED_S + 2.0)

    run_virtually(scenario())

    states = [count for count in counts(rig) if count < 30]
    disturbed = states[2:-6]
    assert len(disturbed) > 100
    assert all(one != next_one for one, next_one in pairwise(disturbed))
    assert set(states[:2]) | set(states[-2:]) == {READ.count}  # calm
    assert {count for count in counts(rig) if count >= 30} == {30}  # what decides nothing


def test_what_is_owed_outlives_the_port() -> None:
    rig = LineRig(no_reply, [])

    def changed(frame: bytes) -> Iterable[Said]:
        return [Said(adu.encode(1, READ.encode_reply((9,) * READ.count)))]

    async def scenario() -> Outcome:
        async with rig:
            await rig.transact(1, READ, Priority.READ_BACK)
            rig.port.hang_up()
            await asyncio.sleep(3.0)
            late = adu.encode(1, reply_pdu(adu.decode(rig.opener.ports[0].sent[0][1]).pdu))
            rig.port.answer = lambda frame: [Said(late)]
            asked = rig.client.transact(
                1, READ, response_time_s=RESPONSE_TIME_S, lane=Priority.READ_BACK, until_s=10.0
            )
            await until(lambda: len(rig.port.sent) == 1)
            rig.port.answer = changed
            return await asked

    outcome = run_virtually(scenario())

    assert isinstance(outcome, Answered)
    assert outcome.value == (9,) * READ.count
    assert len(rig.port.sent) == 4  # the late one; another that differs; two that are equal
