"""The real ports, on a pty and on a TCP connection of this machine."""

from __future__ import annotations

import asyncio
import os

import pytest

from gateway.errors import PortLostError
from gateway.line.port import buffered as lead
from tests.line.fakes import until
from tests.line.opened import LONG_S, Pty, opener, read, read_pty, settled, write_often


async def test_a_tty_carries_bytes_both_ways(pty: Pty) -> None:
    port = await opener(pty.path)()
    loop = asyncio.get_running_loop()
    everything = bytes(range(256))
    assert port.last_byte_s == float("-inf")

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
        assert loop.time() >= until_s - lead.MOST_S
        port.write(b"request")
        assert loop.time() >= until_s

    await settled(port)


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
    await settled(port)


async def test_a_tty_that_hangs_up_is_lost_for_reading_and_writing(pty: Pty) -> None:
    port = await opener(pty.path)()
    os.write(pty.master, b"last words")
    assert await read(port, 10) == b"last words"

    asyncio.get_running_loop().call_soon(pty.hang_up)

    with pytest.raises(PortLostError, match="lost"):
        await port.read(until_s=asyncio.get_running_loop().time() + LONG_S)
    with pytest.raises(PortLostError):
        port.write(b"x")
    await settled(port)


async def test_a_tty_that_takes_no_more_bytes_is_lost_instead_of_waited_for(pty: Pty) -> None:
    port = await opener(pty.path)()

    with pytest.raises(PortLostError, match="stuck"):
        write_often(port, bytes(256))

    await settled(port)
