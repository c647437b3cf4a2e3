"""The real ports on a pty: bytes, times, and how a tty is lost."""

from __future__ import annotations

import asyncio
import fcntl
import os
import struct
import termios

import pytest

from gateway.errors import PortLostError
from gateway.line.port import buffered
from gateway.line.port.buffered import EarlyWakeUp
from gateway.line.port.tty import uart_errors
from tests.line.opened import LONG_S, Pty, opener, read, read_pty, settled
from tests.waiting import until

TIOCGEXCL = 0x80045440  # [linux/asm-generic/ioctls.h]
NO_BYTES_S = 0.0001  # too short to let the loop go on


async def test_a_tty_carries_bytes_both_ways(pty: Pty) -> None:
    port = await opener(pty.path)()
    loop = asyncio.get_running_loop()
    everything = bytes(range(256))
    assert port.last_byte_s == float("-inf")
    assert await port.read(until_s=loop.time() + NO_BYTES_S) == b""  # before it is quite open

    port.write(everything)
    assert await read_pty(pty, 256) == everything
    os.write(pty.master, everything)
    assert await read(port, 256) == everything

    assert 0 <= loop.time() - port.last_byte_s < LONG_S
    assert await port.read(until_s=loop.time()) == b""
    await settled(port)


async def test_a_read_ends_a_moment_before_its_time_and_the_write_after_it_not_before(pty: Pty) -> None:
    port = await opener(pty.path)()
    loop = asyncio.get_running_loop()

    for _ in range(20):
        until_s = loop.time() + 0.003
        assert await port.read(until_s=until_s) == b""
        assert loop.time() >= until_s - buffered.MOST_S
        port.write(b"request")
        assert loop.time() >= until_s

    await settled(port)


def test_one_write_in_five_is_left_late() -> None:
    lead, lates = EarlyWakeUp(), 0

    for number in range(9000):
        lateness_s = 0.00001 + 0.0001 * (number * 7 % 100) / 100  # evenly spread
        left_s = lead.seconds - lateness_s
        lates += left_s < 0.0
        lead.learn(left_s)

    assert 0.15 < lates / 9000 < 0.25


async def test_a_tty_that_is_lost_in_the_middle_of_a_reply_gives_what_came_and_then_the_loss(
    pty: Pty,
) -> None:
    port = await opener(pty.path)()
    loop = asyncio.get_running_loop()
    reading = asyncio.create_task(port.read(until_s=loop.time() + LONG_S, count=20))
    await asyncio.sleep(0)

    os.write(pty.master, b"half")
    await until(lambda: port.last_byte_s > 0)
    pty.hang_up()

    assert await reading == b"half"
    with pytest.raises(PortLostError, match="lost"):
        await port.read(until_s=loop.time() + LONG_S)
    with pytest.raises(PortLostError):
        port.write(b"x")
    await settled(port)


async def test_a_tty_that_takes_no_more_bytes_is_lost_instead_of_waited_for(pty: Pty) -> None:
    port = await opener(pty.path)()

    def write_often() -> None:
        for _ in range(10_000):
            port.write(bytes(256))

    with pytest.raises(PortLostError, match="stuck"):
        write_often()

    await settled(port)


async def test_a_pseudo_terminal_that_an_earlier_gateway_left_exclusive_is_cleared(pty: Pty) -> None:
    theirs = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
    if os.geteuid() == 0:  # no other user may open it then
        fcntl.ioctl(theirs, termios.TIOCEXCL)

    def is_exclusive() -> bool:
        return struct.unpack("i", fcntl.ioctl(theirs, TIOCGEXCL, bytes(4))) != (0,)

    port = await opener(pty.path)()
    found = [is_exclusive()]
    port.close()
    await settled(port)  # which closes it once more

    assert [*found, is_exclusive()] == [False, False]
    os.close(theirs)


def test_the_uarts_error_counters_are_taken_from_the_kernels_struct() -> None:
    asked = []

    def ioctl(fd: int, request: int, octets: bytes) -> bytes:
        asked.append((fd, request, len(octets)))
        return struct.pack("20i", 1, 2, 3, 4, 50, 60, 7, 8, 9, 10, 11, *[0] * 9)

    counters = {"frame": 7, "overrun": 8, "parity": 9, "break": 10, "buffer_overrun": 11}
    assert uart_errors(5, ioctl) == counters
    assert asked == [(5, 0x545D, 80)]
