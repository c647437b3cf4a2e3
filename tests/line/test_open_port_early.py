"""A tty that is read before it is quite open is not taken for one that is gone."""

from __future__ import annotations

import asyncio
import fcntl
import os
import struct
import termios
import tty

from gateway.line.port.opener import SerialOpener
from gateway.modbus.timing import Framing

TIOCGEXCL = 0x80045440  # [linux/asm-generic/ioctls.h]


async def test_a_read_right_after_opening_finds_nothing_and_loses_nothing() -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    try:
        port = await SerialOpener(os.ttyname(theirs), 19200, Framing.parse("8N1"))()
        loop = asyncio.get_running_loop()

        early = await port.read(until_s=loop.time() + 0.0001)  # too short to let the loop go on
        os.write(ours, b"\x01\x02")
        later = await port.read(until_s=loop.time() + 5.0)

        port.close()
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert (early, later) == (b"", b"\x01\x02")
    finally:
        os.close(ours)
        os.close(theirs)


async def test_a_pseudo_terminal_that_an_earlier_gateway_left_exclusive_is_cleared() -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    try:
        if os.geteuid() == 0:  # no other user may open it then
            fcntl.ioctl(theirs, termios.TIOCEXCL)
        port = await SerialOpener(os.ttyname(theirs), 19200, Framing.parse("8N1"))()
        while_open = is_exclusive(theirs)
        port.close()
        port.close()

        assert (while_open, is_exclusive(theirs)) == (False, False)
    finally:
        os.close(ours)
        os.close(theirs)


def is_exclusive(fd: int) -> bool:
    return struct.unpack("i", fcntl.ioctl(fd, TIOCGEXCL, bytes(4))) != (0,)
