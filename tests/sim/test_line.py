"""The virtual line keeps byte times and silences as a real one does."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.modbus.adu import encode
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from tests.sim.wire import TIMING, receive
from tests.virtual_time import run_virtually

READ = bytes.fromhex("01 03 00 DC 00 01 45 F0")  # P220
ANSWER = bytes.fromhex("01 03 02 00 06 38 46")
OF_2 = bytes.fromhex("02 03 00 DC 00 01 45 C3")
BROADCAST = encode(0, bytes.fromhex("05 00 6B 00 00"))
READ_SST = bytes.fromhex("01 04 00 00 00 02 71 CB")
HALF_S, READ_S = TIMING.wire_s(4), TIMING.wire_s(8)


def make_line(family: str = "ssw07", count: int = 1, **options: Any) -> SimulatedLine:
    units = [make_unit(family, address, seed=address) for address in range(1, count + 1)]
    return SimulatedLine(TIMING, units, **options)


async def exchange(line: SimulatedLine, *course: bytes | float) -> bytes:
    """Write frames, with pauses of so many seconds in between; return what arrives until 0.3 s later."""
    port = await line.opener()()
    for each in course:
        if isinstance(each, bytes):
            port.write(each)
        else:
            await asyncio.sleep(each)
    return await receive(port, within_s=0.3)


def halved(frame: bytes, characters: float) -> list[bytes | float]:
    """A frame with a pause behind its fourth byte."""
    return [frame[:4], HALF_S + characters * TIMING.character_s, frame[4:]]


Course = tuple[list[bytes | float], int, str]  # sent to two units; bytes that come; what is recorded
OF_SSW07: dict[str, Course] = {
    "a request is answered": ([READ], 7, ""),
    "W-06 a frame with a wrong CRC gets no answer": ([READ[:-1] + b"\xf1"], 0, "broken"),
    "W-05 a pause of 3.85 characters breaks a frame in two": (halved(READ, 3.85), 0, "broken broken"),
    "W-05 a pause of 3.15 characters does no harm": (halved(READ, 3.15), 7, ""),
    "a request right after a broadcast is recorded": ([BROADCAST, 0.05, READ], 7, "turnaround"),
    "a request into a pending answer garbles it": ([READ, READ_S + 0.0045, OF_2], 7, "collision"),
}
OF_SST: dict[str, Course] = {
    "ST-03 a gap of 1.6 characters makes a frame incomplete": (halved(READ_SST, 1.6), 0, ""),
    "ST-03 a gap of 1.4 characters does no harm": (halved(READ_SST, 1.4), 9, ""),
    "ST-04 a corrupt message gets no answer": ([READ_SST[:-1] + b"\x00"], 0, "broken"),
    "ST-04 a message without its end gets no answer": ([READ_SST[:-1]], 0, "broken"),
    "ST-04 a message without its beginning gets no answer": ([READ_SST[1:]], 0, "broken"),
}


@pytest.mark.parametrize(
    ("family", "course", "size", "violations"),
    [
        pytest.param(family, *course, id=sentence)
        for family, courses in (("ssw07", OF_SSW07), ("sst", OF_SST))
        for sentence, course in courses.items()
    ],
)
def test_a_line_keeps_the_times_of_the_manuals(
    family: str, course: list[bytes | float], size: int, violations: str
) -> None:
    line = make_line(family, 2)

    received = run_virtually(exchange(line, *course))

    assert len(received) == size
    assert [violation.kind for violation in line.violations] == violations.split()


def test_st_03_the_answer_comes_after_a_silence_of_three_and_a_half_characters() -> None:
    async def main() -> None:
        port = await make_line("sst", chunk_bytes=None).opener()()
        port.write(READ_SST)
        reply = await port.read(until_s=1.0)
        assert port.last_byte_s - TIMING.wire_s(len(READ_SST) + len(reply)) >= TIMING.silence_s

    run_virtually(main())


@pytest.mark.parametrize(("share", "is_answered"), [(1.0, True), (0.9, False)])
def test_a_request_after_the_whole_silence_is_answered_and_an_earlier_one_recorded(
    share: float, *, is_answered: bool
) -> None:
    async def main() -> bytes:
        port = await line.opener()()
        port.write(READ)
        await port.read(until_s=10.0, count=len(ANSWER))
        await asyncio.sleep(TIMING.silence_s * share)
        port.write(READ)
        return await receive(port, within_s=0.2)

    line = make_line()

    assert run_virtually(main()) == (ANSWER if is_answered else b"")
    assert [each.kind for each in line.violations] == ([] if is_answered else ["early"])
    assert is_answered or "3.609 ms of 4.010 ms" in str(line.violations[0])


def test_w_03_a_broadcast_reaches_all_units_and_none_answers() -> None:
    line = make_line(count=3)

    assert run_virtually(exchange(line, encode(0, bytes.fromhex("05 00 64 FF 00")))) == b""
    assert [unit.motor.is_turned_on for unit in line.units] == [True, True, True]
