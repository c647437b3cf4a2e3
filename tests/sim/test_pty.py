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
from tests.waiting import until

READ = bytes.fromhex("01 03 00 DC 00 01 45 F0")  # P220
ANSWER = bytes.fromhex("01 03 02 00 06 38 46")


def make_pty(link: Path | None = None) -> PtyLine:
    line = SimulatedLine(TIMING, [make_unit("ssw07", 1)], chunk_bytes=None, tolerance_s=0.0002)
    return PtyLine(line, link=link)


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
    ("rate", "stop_bits", "answer"),
    [
        (termios.B9600, termios.CSTOPB, ANSWER),
        (termios.B19200, termios.CSTOPB, b""),
        (termios.B9600, 0, b""),
    ],
)
async def test_a_master_is_answered_at_the_rate_and_stop_bits_that_it_sets(
    rate: int, stop_bits: int, answer: bytes
) -> None:
    served = make_pty()
    await served.start()
    end = os.open(served.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    attributes, received = termios.tcgetattr(end), bytearray()
    attributes[2] = attributes[2] & ~termios.CSTOPB | stop_bits
    attributes[4] = attributes[5] = rate
    termios.tcsetattr(end, termios.TCSANOW, attributes)
    asyncio.get_running_loop().add_reader(end, lambda: received.extend(os.read(end, 256)))

    os.write(end, READ)
    await until(lambda: served.line.transcript and len(received) == len(answer))

    assert received == answer
    assert bool(served.line.units[0].handled) is bool(answer)
    asyncio.get_running_loop().remove_reader(end)
    os.close(end)
    await served.stop()
    await served.stop()
