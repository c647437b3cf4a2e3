"""The virtual line keeps byte times and silences as a real one does."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from gateway.errors import PortError, PortLostError
from gateway.line.port.base import Port, PortOpener
from gateway.modbus.adu import encode
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from tests.sim.wire import TIMING, receive
from tests.virtual_time import run_virtually

READ = encode(1, ReadHoldingRegisters(2, 2).encode())


def make_line(count: int = 1, **options: object) -> SimulatedLine:
    units = [make_unit("ssw07", address, seed=address) for address in range(1, count + 1)]
    return SimulatedLine(TIMING, units, **options)  # type: ignore[arg-type]  # a test's shorthand


def test_the_opener_and_its_port_have_the_shape_of_the_seam() -> None:
    async def main() -> None:
        opener: PortOpener = make_line().opener()
        port: Port = await opener()

        assert opener.name == "simulated"
        assert port.last_byte_s == float("-inf")

    run_virtually(main())


def test_a_reply_comes_after_request_time_delay_and_its_own_bytes() -> None:
    async def main() -> None:
        line = make_line(chunk_bytes=None)
        port = await line.opener()()
        asked_s = asyncio.get_running_loop().time()

        port.write(READ)
        reply = await port.read(until_s=asked_s + 1)

        assert len(reply) == 9
        delay_s = port.last_byte_s - asked_s - TIMING.wire_s(len(READ) + len(reply))
        assert 0.005 <= delay_s <= 0.020
        assert line.violations == []

    run_virtually(main())


def test_reply_bytes_arrive_one_by_one_at_their_times() -> None:
    async def main() -> None:
        port = await make_line().opener()()
        loop = asyncio.get_running_loop()
        port.write(READ)

        arrivals_s = []
        for _ in range(9):
            chunk = await port.read(until_s=loop.time() + 1)
            assert len(chunk) == 1
            arrivals_s.append(port.last_byte_s)

        gaps_s = [later - sooner for sooner, later in pairwise(arrivals_s)]
        assert gaps_s == pytest.approx([TIMING.character_s] * 8)

    run_virtually(main())


def test_a_reader_is_woken_once_for_the_bytes_that_it_waits_for_and_gets_what_there_is_at_its_deadline() -> (
    None
):
    async def main() -> None:
        port = await make_line().opener()()
        loop = asyncio.get_running_loop()
        port.write(READ)

        head = await port.read(until_s=loop.time() + 1, count=2)
        part = await port.read(until_s=loop.time() + 3.5 * TIMING.character_s, count=7)
        part_s = port.last_byte_s
        rest = await port.read(until_s=loop.time() + 1, count=4)

        assert (len(head), len(part), len(rest)) == (2, 3, 4)
        assert port.last_byte_s - part_s == pytest.approx(4 * TIMING.character_s)
        assert loop.time() == pytest.approx(port.last_byte_s)

    run_virtually(main())


def test_a_collision_garbles_only_what_had_not_arrived_before() -> None:
    async def main(*, collides: bool) -> bytes:
        port = await make_line().opener()()
        loop = asyncio.get_running_loop()
        port.write(READ)
        first = await port.read(until_s=loop.time() + 1)
        await asyncio.sleep(3.5 * TIMING.character_s)
        if collides:
            port.write(READ)
        return first + await receive(port, within_s=1.0)

    whole, garbled = (run_virtually(main(collides=each)) for each in (False, True))

    assert [a == b for a, b in zip(whole, garbled, strict=True)] == [True] * 4 + [False] * 5


async def answer_after_silence(line: SimulatedLine, silence_s: float) -> bytes:
    port = await line.opener()()
    port.write(READ)
    received = b""
    while len(received) < 9:
        received += await port.read(until_s=10.0)
    await asyncio.sleep(silence_s)
    port.write(READ)
    return await receive(port, within_s=0.2)


def test_a_request_after_the_whole_silence_is_answered() -> None:
    line = make_line()

    reply = run_virtually(answer_after_silence(line, TIMING.silence_s))

    assert len(reply) == 9
    assert line.violations == []


def test_a_request_that_comes_too_early_gets_no_answer_and_is_recorded() -> None:
    line = make_line()

    reply = run_virtually(answer_after_silence(line, TIMING.silence_s * 0.9))

    assert reply == b""
    assert [violation.kind for violation in line.violations] == ["early"]
    assert "3.609 ms of 4.010 ms" in str(line.violations[0])


def test_w_05_a_pause_inside_a_frame_of_more_than_the_silence_breaks_it_in_two() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        port.write(READ[:4])
        await asyncio.sleep(TIMING.wire_s(4) + TIMING.silence_s * 1.1)
        port.write(READ[4:])

        assert await receive(port, within_s=0.2) == b""
        assert [violation.kind for violation in line.violations] == ["broken", "broken"]

    run_virtually(main())


def test_w_05_a_shorter_pause_inside_a_frame_does_no_harm() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        port.write(READ[:4])
        await asyncio.sleep(TIMING.wire_s(4) + TIMING.silence_s * 0.9)
        port.write(READ[4:])

        assert len(await receive(port, within_s=0.2)) == 9
        assert line.violations == []

    run_virtually(main())


def test_w_06_a_frame_with_a_wrong_crc_gets_no_answer() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        port.write(READ[:-1] + bytes((READ[-1] ^ 1,)))

        assert await receive(port, within_s=0.2) == b""

    run_virtually(main())


def test_w_03_a_broadcast_reaches_all_units_and_none_answers() -> None:
    async def main() -> None:
        line = make_line(3)
        port = await line.opener()()
        port.write(encode(0, WriteCoil(100, is_on=True).encode()))

        assert await receive(port, within_s=0.2) == b""
        assert [unit.motor.is_turned_on for unit in line.units] == [True, True, True]

    run_virtually(main())


def test_a_request_right_after_a_broadcast_is_recorded() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        port.write(encode(0, WriteCoil(107, is_on=False).encode()))
        await asyncio.sleep(0.05)
        port.write(READ)
        await receive(port, within_s=0.2)

        assert [violation.kind for violation in line.violations] == ["turnaround"]

    run_virtually(main())


def test_a_request_into_a_pending_answer_collides_with_it() -> None:
    async def main() -> None:
        line = make_line(2)
        port = await line.opener()()
        port.write(READ)
        await asyncio.sleep(TIMING.wire_s(len(READ)) + 0.0045)
        port.write(encode(2, ReadHoldingRegisters(2, 2).encode()))
        received = await receive(port, within_s=0.3)

        assert len(received) == 9  # the second request was corrupted: one garbled reply only
        assert [violation.kind for violation in line.violations] == ["collision"]

    run_virtually(main())


def test_a_request_while_a_unit_is_sending_collides_with_it() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        port.write(READ)
        await port.read(until_s=1.0)
        port.write(READ)
        await receive(port, within_s=0.3)

        assert [violation.kind for violation in line.violations] == ["collision"]

    run_virtually(main())


def test_units_ignore_a_master_of_another_speed_or_framing() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener(timing=LineTiming(19200, Framing.parse("8E1")))()
        port.write(READ)

        assert await receive(port, within_s=0.3) == b""

    run_virtually(main())


def test_the_transcript_shows_frames_with_times_in_order() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        port.write(READ)
        await receive(port, within_s=0.2)

        request, reply = line.transcript
        assert str(request) == "0.0000 >> 01 03 00 02 00 02 65 CB"
        assert str(reply).split(" ", 1)[1].startswith("<< 01 03 04 ")
        assert reply.start_s > request.end_s

    run_virtually(main())


def test_a_port_can_be_opened_once_at_a_time() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        with pytest.raises(PortError, match="busy"):
            await line.opener()()

        port.close()
        port.close()

        assert (await line.opener()()).is_open
        with pytest.raises(PortLostError):
            port.write(READ)

    run_virtually(main())


def test_pulling_the_adapter_out_wakes_a_reader_and_forbids_opening() -> None:
    async def main() -> None:
        line = make_line()
        port = await line.opener()()
        asyncio.get_running_loop().call_later(1.0, line.unplug)

        with pytest.raises(PortLostError, match="unplugged"):
            await port.read(until_s=5.0)
        with pytest.raises(PortError, match="no such device"):
            await line.opener()()

        line.plug_in()
        assert (await line.opener()()).is_open

    run_virtually(main())


def test_reading_ends_empty_handed_at_the_deadline() -> None:
    async def main() -> None:
        port = await make_line().opener()()

        assert await port.read(until_s=3.0) == b""
        assert asyncio.get_running_loop().time() == pytest.approx(3.0)

    run_virtually(main())


def test_the_same_seed_gives_the_same_course() -> None:
    async def main() -> list[str]:
        line = make_line(chunk_bytes=None)
        port = await line.opener()()
        for _ in range(5):
            port.write(READ)
            await receive(port, within_s=0.1)
        return [str(frame) for frame in line.transcript]

    assert run_virtually(main()) == run_virtually(main())
