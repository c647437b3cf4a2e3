"""What happens while the silence between two requests runs."""

from __future__ import annotations

import asyncio

import pytest

from gateway.line.rtu.outcome import TOO_LATE, Answered, Outcome, Silent
from gateway.line.scheduler.requests import Job, Priority
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import DELAY_S, RESPONSE_TIME_S, TIMING, LineRig, Said, Units, poll
from tests.virtual_time import run_virtually

WRITE = WriteRegister(5003, 1)
STOP = WriteRegister(5003, 0)
READ = ReadHoldingRegisters(0, 10)
REPLY = adu.encode(1, READ.encode_reply(range(10)))
ONE_S = TIMING.wire_s(8 + 25) + DELAY_S + TIMING.silence_s


async def into_a_silence(rig: LineRig) -> None:
    """Sleep until a reply has just ended, so that the next request is chosen and not yet sent."""
    while not rig.port.sent:  # noqa: ASYNC110 - in virtual time
        await asyncio.sleep(0.0001)
    begun_s = rig.port.sent[-1][0]
    end_s = begun_s + TIMING.wire_s(8 + 25) + DELAY_S
    await asyncio.sleep(end_s + TIMING.silence_s / 2 - asyncio.get_running_loop().time())


def functions(rig: LineRig) -> list[int]:
    return [frame[1] for _, frame in rig.port.sent]


@pytest.mark.parametrize(("request_", "lane"), [(STOP, Priority.STOP), (WRITE, Priority.COMMAND)])
def test_what_comes_in_the_silence_goes_before_the_poll_that_was_chosen(
    request_: WriteRegister, lane: Priority
) -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

    async def scenario() -> None:
        async with rig:
            await into_a_silence(rig)
            await rig.transact(1, request_, lane)

    run_virtually(scenario())

    assert functions(rig)[:2] == [3, 6]


def test_a_stop_that_comes_in_the_silence_goes_before_the_command_that_was_chosen() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

    async def scenario() -> list[Outcome]:
        async with rig:
            await into_a_silence(rig)
            waiting = asyncio.create_task(rig.transact(1, WRITE))
            await asyncio.sleep(TIMING.silence_s / 4)
            return list(await asyncio.gather(rig.transact(1, STOP, Priority.STOP), waiting))

    outcomes = run_virtually(scenario())

    assert all(isinstance(outcome, Answered) for outcome in outcomes)
    written = [frame[4:6] for _, frame in rig.port.sent if frame[1] == 6]
    assert written == [b"\x00\x00", b"\x00\x01"]


def test_a_chosen_command_that_is_given_up_before_it_is_sent_is_never_sent() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

    async def scenario() -> bool:
        job = Job(1, WRITE, RESPONSE_TIME_S, Priority.COMMAND, lambda outcome: None)
        async with rig:
            rig.line.submit(job)
            rig.line.submit(job)
            while functions(rig).count(6) < 1:  # noqa: ASYNC110 - in virtual time
                await asyncio.sleep(0.0005)
            at_s = rig.port.sent[-1][0] + TIMING.wire_s(16) + DELAY_S + TIMING.silence_s / 2
            await asyncio.sleep(at_s - asyncio.get_running_loop().time())
            is_withdrawn = rig.line.withdraw(job)
            await asyncio.sleep(0.2)
            return is_withdrawn

    assert run_virtually(scenario())
    assert functions(rig).count(6) == 1


@pytest.mark.parametrize("is_given_up", [False, True])
def test_a_read_that_is_given_up_while_it_is_on_the_wire_is_not_repeated_for_a_corrupted_reply(
    *, is_given_up: bool
) -> None:
    rig = LineRig(lambda _: [Said(REPLY[:-1] + bytes((REPLY[-1] ^ 0xFF,)))], [])

    async def scenario() -> None:
        async with rig:
            asked = asyncio.create_task(rig.transact(1, READ, Priority.READ_BACK))
            await asyncio.sleep(TIMING.wire_s(8))
            if is_given_up:
                asked.cancel()
            await asyncio.sleep(1.0)

    run_virtually(scenario())

    assert len(rig.port.sent) == (1 if is_given_up else 2)


def test_the_answer_to_the_last_request_is_reported_at_once() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=10.0)])

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(1.0)

    run_virtually(scenario())

    assert rig.listener.polls[0][0] - rig.port.sent[0][0] == pytest.approx(ONE_S, abs=1e-6)


def test_every_frame_is_handed_on_while_somebody_captures() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.1)])

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(0.25)
            rig.line.events.capture(is_on=True)
            await asyncio.sleep(0.2)
            rig.line.events.capture(is_on=False)
            await asyncio.sleep(0.2)

    run_virtually(scenario())

    frames = rig.listener.frames
    assert [(each.line, each.direction) for each in frames] == [("pumps", ">>"), ("pumps", "<<")] * 2
    assert frames[1].frame == REPLY
    assert frames[1].at_s - frames[0].at_s == pytest.approx(ONE_S - TIMING.silence_s)


def test_a_job_whose_time_is_over_when_its_slot_comes_is_never_sent() -> None:
    rig = LineRig(Units({1}), [poll("a", every_s=0.0)])

    async def scenario() -> tuple[Outcome, Outcome]:
        async with rig:
            await into_a_silence(rig)
            now_s = asyncio.get_running_loop().time()
            client, asked = rig.client, {"response_time_s": RESPONSE_TIME_S, "lane": Priority.COMMAND}
            too_late = client.transact(1, WRITE, until_s=now_s, **asked)
            in_time = client.transact(1, WRITE, until_s=now_s + ONE_S, **asked)
            return await asyncio.gather(too_late, in_time)

    too_late, in_time = run_virtually(scenario())

    assert too_late == Silent(TOO_LATE, is_sent=False)
    assert isinstance(in_time, Answered)
    assert functions(rig).count(6) == 1


def test_a_bug_while_an_outcome_is_recorded_ends_its_job_all_the_same() -> None:
    async def scenario() -> None:
        async with LineRig(Units({1}), []) as rig:
            serving = rig.line._service
            assert serving is not None

            def fail(*_: object, **__: object) -> None:
                raise ZeroDivisionError

            serving._statistics.note = fail  # type: ignore[method-assign]
            outcome = await asyncio.wait_for(rig.transact(1, ReadHoldingRegisters(0, 1)), 5.0)

            assert outcome == Silent("line crashed", is_sent=True)
            with pytest.raises(ZeroDivisionError):
                await rig.task
            rig.task = asyncio.create_task(asyncio.sleep(0.0))

    run_virtually(scenario())
