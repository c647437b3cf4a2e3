"""The virtual line on a real pseudo terminal."""

from __future__ import annotations

import asyncio
import os
import termios
from pathlib import Path

import pytest

from gateway.errors import PortError
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.bus.pty import PtyLine
from gateway.sim.factory import make_unit
from tests.sim.wire import TIMING

READ = bytes.fromhex("01 03 00 DC 00 01 45 F0")  # P220
ANSWER = bytes.fromhex("01 03 02 00 06 38 46")


def make_pty(link: Path | None = None) -> PtyLine:
    line = SimulatedLine(TIMING, [make_unit("ssw07", 1)], chunk_bytes=None, tolerance_s=0.0002)
    return PtyLine(line, link=link)


async def ask(path: str, frame: bytes, size: int) -> bytes:
    """Write a frame to a serial port and return the first `size` bytes of the answer."""
    end = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    received = bytearray()
    is_whole = asyncio.Event()

    def take() -> None:
        received.extend(os.read(end, 256))
        if len(received) >= size:
            is_whole.set()

    loop = asyncio.get_running_loop()
    loop.add_reader(end, take)
    try:
        os.write(end, frame)
        await asyncio.wait_for(is_whole.wait(), 10.0)
    finally:
        loop.remove_reader(end)
        os.close(end)
    return bytes(received)


async def taken(line: SimulatedLine) -> None:
    """Return once a frame of the master has ended."""
    loop = asyncio.get_running_loop()
    is_taken = loop.create_future()

    def look() -> None:
        if line.transcript:
            is_taken.set_result(None)
        else:
            loop.call_later(0.001, look)

    look()
    await is_taken


async def test_a_master_gets_its_answer_through_the_terminal() -> None:
    served = make_pty()
    await served.start()

    reply = await ask(served.path, READ, 7)

    assert reply == ANSWER
    assert served.line.violations == []
    await served.stop()
    await served.stop()


async def test_a_link_never_replaces_a_file_or_a_link_to_something_else(tmp_path: Path) -> None:
    file, other = tmp_path / "pumps", tmp_path / "fans"
    file.write_text("precious")
    other.symlink_to(tmp_path)

    with pytest.raises(PortError, match="choose another path"):
        await make_pty(file).start()
    with pytest.raises(PortError):
        await make_pty(other).start()

    assert file.read_text() == "precious"
    assert other.readlink() == tmp_path


@pytest.mark.parametrize(
    ("rate", "stop_bits", "answers"),
    [
        (termios.B9600, termios.CSTOPB, True),
        (termios.B19200, termios.CSTOPB, False),
        (termios.B9600, 0, False),
    ],
)
async def test_a_master_is_understood_at_the_rate_and_stop_bits_that_it_sets(
    rate: int, stop_bits: int, *, answers: bool
) -> None:
    served = make_pty()
    await served.start()
    end = os.open(served.path, os.O_RDWR | os.O_NOCTTY)
    attributes = termios.tcgetattr(end)
    attributes[2] = attributes[2] & ~termios.CSTOPB | stop_bits
    attributes[4] = attributes[5] = rate
    termios.tcsetattr(end, termios.TCSANOW, attributes)

    os.write(end, READ)
    async with asyncio.timeout(10.0):
        await taken(served.line)
    os.close(end)

    assert bool(served.line.units[0].handled) is answers
    await served.stop()
