"""The virtual line keeps byte times and silences as a real one does."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.modbus.adu import encode
from gateway.modbus.timing import LineTiming
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from tests.sim.wire import TIMING, receive
from tests.virtual_time import run_virtually

READ = bytes.fromhex("01 03 00 DC 00 01 45 F0")  # P220
ANSWER = bytes.fromhex("01 03 02 00 06 38 46")
OF_2 = bytes.fromhex("02 03 00 DC 00 01 45 C3")
HALF_S, READ_S = TIMING.wire_s(4), TIMING.wire_s(8)


def make_line(count: int = 1, **options: Any) -> SimulatedLine:
    units = [make_unit("ssw07", address, seed=address) for address in range(1, count + 1)]
    return SimulatedLine(TIMING, units, **options)


async def exchange(line: SimulatedLine, *course: bytes | float, timing: LineTiming | None = None) -> bytes:
    """Write frames, with pauses of so many seconds in between; return what arrives until 0.3 s later."""
    port = await line.opener(timing=timing)()
    for each in course:
        if isinstance(each, bytes):
            port.write(each)
        else:
            await asyncio.sleep(each)
    return await receive(port, within_s=0.3)


COURSES = {
    "a request is answered": (1, [READ], 1, ""),
    "W-06 a frame with a wrong CRC gets no answer": (1, [READ[:-1] + b"\xf1"], 0, "broken"),
    "W-05 a pause inside a frame of more than the silence breaks it in two": (
        1,
        [READ[:4], HALF_S + TIMING.silence_s * 1.1, READ[4:]],
        0,
        "broken broken",
    ),
    "W-05 a shorter pause inside a frame does no harm": (
        1,
        [READ[:4], HALF_S + TIMING.silence_s * 0.9, READ[4:]],
        1,
        "",
    ),
    "a request right after a broadcast is recorded": (
        1,
        [encode(0, bytes.fromhex("05 00 6B 00 00")), 0.05, READ],
        1,
        "turnaround",
    ),
    "a request into a pending answer collides: one garbled reply only": (
        2,
        [READ, READ_S + 0.0045, OF_2],
        1,
        "collision",
    ),
}


@pytest.mark.parametrize(
    ("units", "course", "replies", "violations"), list(COURSES.values()), ids=list(COURSES)
)
def test_a_line_keeps_the_times_of_the_manuals(
    units: int, course: list[bytes | float], replies: int, violations: str
) -> None:
    line = make_line(units)

    received = run_virtually(exchange(line, *course))

    assert len(received) == replies * len(ANSWER)
    assert [violation.kind for violation in line.violations] == violations.split()


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
    line = make_line(3)

    assert run_virtually(exchange(line, encode(0, bytes.fromhex("05 00 64 FF 00")))) == b""
    assert [unit.motor.is_turned_on for unit in line.units] == [True, True, True]
