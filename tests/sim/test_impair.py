"""Impairments corrupt replies on order, and alike for the same seed."""

from __future__ import annotations

import asyncio
import random

import pytest

from gateway.errors import BadFrameError
from gateway.modbus.adu import decode, encode
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.sim.bus.faults import (
    Babbling,
    CutShort,
    Doubled,
    Impairment,
    Late,
    Noisy,
    NoReply,
    Reply,
    WrongUnit,
)
from gateway.sim.bus.port import SimulatedLine, SimulatedPort
from gateway.sim.factory import make_unit
from tests.sim.wire import TIMING, receive
from tests.virtual_time import run_virtually

READ = encode(1, ReadHoldingRegisters(220, 1).encode())
ANSWER = encode(1, ReadHoldingRegisters(220, 1).encode_reply((6,)))


def make_line(*, seed: int = 0) -> SimulatedLine:
    return SimulatedLine(TIMING, [make_unit("ssw07", 1)], seed=seed, chunk_bytes=None)


async def ask(port: SimulatedPort) -> bytes:
    port.write(READ)
    return await receive(port, within_s=0.5)


def replies(
    impairment: Impairment, *, count: int | None = None, times: int = 1, chance: float = 1.0
) -> list[bytes]:
    async def main() -> list[bytes]:
        line = make_line()
        line.impair(1, impairment, count=count, chance=chance)
        port = await line.opener()()
        return [await ask(port) for _ in range(times)]

    return run_virtually(main())


def test_a_silent_unit_acts_but_does_not_answer() -> None:
    assert replies(NoReply()) == [b""]


def test_an_impairment_may_concern_the_next_replies_only() -> None:
    assert replies(NoReply(), count=2, times=4) == [b"", b"", ANSWER, ANSWER]


def test_an_impairment_may_happen_by_chance() -> None:
    got = replies(NoReply(), chance=0.5, times=20)

    assert 3 <= got.count(b"") <= 17


def test_a_healed_unit_answers_again() -> None:
    async def main() -> bytes:
        line = make_line()
        line.impair(1, NoReply())
        line.heal(1)
        line.heal(1)
        return await ask(await line.opener()())

    assert run_virtually(main()) == ANSWER


def test_a_late_reply_comes_after_the_longest_time_of_the_manual() -> None:
    async def main() -> float:
        line = make_line()
        line.impair(1, Late(3.0))
        await ask(await line.opener()())
        request, reply = line.transcript
        return reply.start_s - request.end_s

    assert run_virtually(main()) == pytest.approx(0.060)


def test_a_noisy_reply_fails_its_check() -> None:
    (got,) = replies(Noisy(0.2))

    assert len(got) == len(ANSWER)
    with pytest.raises(BadFrameError):
        decode(got)


def test_a_wrong_unit_answers_with_a_right_check() -> None:
    (got,) = replies(WrongUnit(7))

    assert decode(got).unit == 7


def test_a_reply_may_be_cut_short() -> None:
    assert replies(CutShort(3)) == [ANSWER[:-3]]
    assert replies(CutShort(99)) == [b""]


def test_a_reply_may_come_twice() -> None:
    assert replies(Doubled()) == [ANSWER * 2]


def test_a_babbling_unit_sends_bytes_that_no_one_asked_for() -> None:
    async def main() -> list[bytes]:
        line = make_line()
        port = await line.opener()()
        line.impair(1, Babbling(every_s=1.0, byte_count=4))
        unasked = await receive(port, within_s=5.0)
        line.heal(1)
        return [unasked, await receive(port, within_s=5.0)]

    unasked, afterwards = run_virtually(main())

    assert len(unasked) >= 12
    assert len(unasked) % 4 == 0
    assert afterwards == b""


def test_a_unit_that_was_ordered_to_babble_begins_once_a_master_is_there() -> None:
    async def main() -> bytes:
        line = make_line()
        line.impair(1, Babbling(every_s=1.0))
        return await receive(await line.opener()(), within_s=5.0)

    assert run_virtually(main())


def test_babbling_answers_rightly_in_between() -> None:
    assert replies(Babbling(every_s=100.0)) == [ANSWER]


def test_a_babble_into_a_request_corrupts_it() -> None:
    async def main() -> SimulatedLine:
        line = make_line()
        port = await line.opener()()
        line.impair(1, Babbling(every_s=0.004, byte_count=2))
        await ask(port)
        line.heal(1)
        return line

    line = run_virtually(main())

    assert "collision" in {violation.kind for violation in line.violations}
    assert line.units[0].handled == 0


def test_noise_on_the_line_corrupts_requests_without_blaming_the_master() -> None:
    async def main() -> SimulatedLine:
        line = make_line()
        line.noise = Noisy(0.3)
        assert await ask(await line.opener()()) == b""
        return line

    line = run_virtually(main())

    assert line.violations == []
    assert line.units[0].handled == 0


def test_two_units_with_one_address_garble_each_other() -> None:
    async def main() -> bytes:
        units = [make_unit("ssw07", 1, seed=seed) for seed in (1, 2)]
        for unit in units:
            unit.response_s = (0.010, 0.010)
        line = SimulatedLine(TIMING, units, chunk_bytes=None)
        return await ask(await line.opener()())

    got = run_virtually(main())

    assert ANSWER not in got
    assert len(got) == 2 * len(ANSWER)


def test_the_same_dice_give_the_same_noise() -> None:
    reply = Reply(ANSWER, 0.01, 0.02)

    assert Noisy(0.1).apply(reply, random.Random(5)) == Noisy(0.1).apply(reply, random.Random(5))


def test_a_unit_taken_off_the_line_is_gone() -> None:
    async def main() -> bytes:
        line = make_line()
        line.remove(line.unit(1))
        return await ask(await line.opener()())

    assert run_virtually(main()) == b""


def test_units_live_on_while_no_one_asks() -> None:
    async def main() -> None:
        line = make_line()
        await line.opener()()
        late = make_unit("ssw07", 2)
        line.add(late)
        await asyncio.sleep(100.0)
        line.advance()

        assert line.unit(1).motor.powered_s == pytest.approx(100.0)
        assert late.motor.powered_s == pytest.approx(100.0)

    run_virtually(main())
