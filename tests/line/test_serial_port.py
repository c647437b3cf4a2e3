"""The real ports, on a pty and on a TCP connection of this machine."""

from __future__ import annotations

import asyncio
import errno
import os
import termios
import threading
import tty
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest
import serial

from gateway.errors import PortError, PortLostError
from gateway.line import open_port, serial_port
from gateway.line.port import Port
from gateway.line.serial_port import SerialOpener, port_error
from gateway.modbus.timing import Framing
from tests.line.fakes import until

FRAMING = Framing.parse("8E1")
LONG_S = 5.0


@dataclass
class Pty:
    master: int
    path: str

    def hang_up(self) -> None:
        os.close(self.master)
        self.master = -1


@pytest.fixture
def pty() -> Iterator[Pty]:
    master, slave = os.openpty()
    tty.setraw(slave)
    pair = Pty(master, os.ttyname(slave))
    os.close(slave)
    os.set_blocking(master, False)
    yield pair
    if pair.master >= 0:
        pair.hang_up()


def opener(path: str, baud: int = 19200, framing: Framing = FRAMING) -> SerialOpener:
    return SerialOpener(path, baud, framing)


async def read(port: Port, size: int) -> bytes:
    """Read so many bytes, in whatever chunks."""
    until_s = asyncio.get_running_loop().time() + LONG_S
    received = b""
    while len(received) < size:
        chunk = await port.read(until_s=until_s)
        assert chunk, f"only {received!r} came"
        received += chunk
    return received


async def read_pty(pair: Pty, size: int) -> bytes:
    loop = asyncio.get_running_loop()
    received = b""
    while len(received) < size:
        ready = loop.create_future()
        loop.add_reader(pair.master, ready.set_result, None)
        await asyncio.wait_for(ready, LONG_S)
        loop.remove_reader(pair.master)
        received += os.read(pair.master, 4096)
    return received


def write_often(port: Port, frame: bytes) -> None:
    for _ in range(10_000):
        port.write(frame)


async def settled(port: Port) -> None:
    """Return once a closed port's descriptor is closed."""
    port.close()
    await port.wait_closed()  # type: ignore[attr-defined] # no part of Port


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
        assert loop.time() >= until_s - open_port.EARLY_MOST_S
        port.write(b"request")
        assert loop.time() >= until_s

    await settled(port)


async def test_a_port_learns_how_early_it_must_be_woken(pty: Pty) -> None:
    port = await opener(pty.path)()

    for _ in range(1000):
        port._learn_to_wake(0.0)
    assert port._early_s == open_port.EARLY_MOST_S
    for _ in range(1000):
        port._learn_to_wake(0.0001)
    assert port._early_s == open_port.EARLY_LEAST_S

    await settled(port)


async def test_bytes_that_come_while_a_read_is_about_to_end_are_returned(pty: Pty) -> None:
    port = await opener(pty.path)()
    loop = asyncio.get_running_loop()
    await port.read(until_s=loop.time() + 0.001)

    os.write(pty.master, b"stray")
    deadline_s = loop.time() + LONG_S
    chunk = b""
    while not chunk and loop.time() < deadline_s:
        chunk = await port.read(until_s=loop.time())

    assert chunk == b"stray"
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


async def test_a_port_that_is_closed_while_a_reply_comes_looks_no_more(pty: Pty) -> None:
    port = await opener(pty.path)()
    loop = asyncio.get_running_loop()
    reading = asyncio.create_task(port.read(until_s=loop.time() + LONG_S, count=2000))
    await asyncio.sleep(0)
    os.write(pty.master, b"half")
    await until(lambda: port.last_byte_s > 0)

    port.close()

    assert await reading == b"half"
    await settled(port)


async def test_a_reply_that_comes_byte_by_byte_wakes_its_reader_once(pty: Pty) -> None:
    port = await opener(pty.path)()
    loop = asyncio.get_running_loop()
    reading = asyncio.create_task(port.read(until_s=loop.time() + LONG_S, count=20))
    await asyncio.sleep(0)

    for number in range(20):
        os.write(pty.master, bytes((number,)))
        await asyncio.sleep(0.0005)

    assert await reading == bytes(range(20))
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


async def test_a_write_that_meets_the_hang_up_first_is_told_too(pty: Pty) -> None:
    port = await opener(pty.path)()
    pty.hang_up()

    with pytest.raises(PortLostError):
        port.write(b"x")
    await settled(port)


async def test_a_tty_that_takes_no_more_bytes_is_lost_instead_of_waited_for(pty: Pty) -> None:
    port = await opener(pty.path)()

    with pytest.raises(PortLostError, match="stuck"):
        write_often(port, bytes(256))

    await settled(port)


async def test_a_closed_port_may_be_closed_again_and_is_lost(pty: Pty) -> None:
    port = await opener(pty.path)()

    port.close()  # before asyncio has even told that it is open
    port.close()

    with pytest.raises(PortLostError, match="closed"):
        await port.read(until_s=0.0)
    await settled(port)


async def test_reopening_waits_until_the_port_before_is_closed(pty: Pty) -> None:
    opens = opener(pty.path)
    before = len(os.listdir("/proc/self/fd"))

    for number in range(20):
        port = await opens()
        port.write(bytes((number,)))
        assert await read_pty(pty, 1) == bytes((number,))
        if number % 2:
            port.close()
    await settled(port)

    assert len(os.listdir("/proc/self/fd")) == before


async def test_a_second_opener_finds_the_port_busy(pty: Pty) -> None:
    port = await opener(pty.path)()

    with pytest.raises(PortError, match=r"busy \(another program holds it"):
        await opener(pty.path)()

    await settled(port)


async def test_unread_bytes_are_kept_up_to_a_limit(pty: Pty) -> None:
    port = await opener(pty.path)()
    pattern = bytes(range(256)) * 4

    for _ in range(8):
        os.write(pty.master, pattern)
        written_s = asyncio.get_running_loop().time()
        await until(lambda written_s=written_s: port.last_byte_s >= written_s)

    assert len(await port.read(until_s=0.0)) <= open_port.KEPT_BYTES
    await settled(port)


@pytest.mark.parametrize(
    ("path", "told"),
    [
        ("/dev/serial/by-id/nowhere", "no such port (plug the adapter in"),
        ("/dev/null", "not a serial port"),
        ("/etc/hostname", "not a serial port"),
        ("socket://", "write socket://host:port"),
        ("socket://[half:1", "write socket://host:port"),
        ("rfc2217://host:1", "write socket://host:port"),
    ],
)
async def test_what_cannot_be_opened_is_told_with_its_mend(path: str, told: str) -> None:
    with pytest.raises(PortError) as caught:
        await opener(path)()

    assert told in str(caught.value)
    assert caught.value.port == path


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (PermissionError(errno.EACCES, "denied"), "add the user to group dialout"),
        (serial.SerialException(errno.EBUSY, "busy"), "another program holds it"),
        (OSError(errno.EIO, "io"), "unplug the adapter"),
        (termios.error(errno.ENOTTY, "no tty"), "not a serial port"),
        (ValueError("Invalid baud rate: 7"), "Invalid baud rate: 7"),
    ],
)
def test_errors_of_the_system_are_told_in_a_users_words(error: Exception, told: str) -> None:
    assert told in str(port_error("/dev/ttyUSB0", error))


async def test_a_descriptor_that_select_cannot_serve_is_refused(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_port, "_SELECT_LIMIT", 3)
    before = len(os.listdir("/proc/self/fd"))

    with pytest.raises(PortError, match="too many open files"):
        await opener(pty.path)()

    assert len(os.listdir("/proc/self/fd")) == before


async def test_a_tty_that_does_not_open_in_time_is_given_up_and_closed_when_it_does(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    opens = opener(pty.path)
    may_open = threading.Event()
    open_device = opens._open_device
    opened: list[serial.Serial] = []

    def open_late() -> serial.Serial:
        may_open.wait(LONG_S)
        opened.append(open_device())
        return opened[0]

    monkeypatch.setattr(opens, "_open_device", open_late)
    monkeypatch.setattr(serial_port, "OPEN_LIMIT_S", 0.01)

    with pytest.raises(PortError, match="does not open within"):
        await opens()
    may_open.set()
    await until(lambda: bool(opened) and not opened[0].is_open)


async def test_a_tty_that_fails_to_open_too_late_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    opens = opener("/dev/ttyUSB0")
    may_fail, has_failed = threading.Event(), threading.Event()

    def fail_late() -> serial.Serial:
        may_fail.wait(LONG_S)
        has_failed.set()
        raise PortError(opens.name, "too late")

    monkeypatch.setattr(opens, "_open_device", fail_late)
    monkeypatch.setattr(serial_port, "OPEN_LIMIT_S", 0.01)

    with pytest.raises(PortError, match="does not open within"):
        await opens()
    may_fail.set()
    await until(has_failed.is_set)
    await asyncio.get_running_loop().shutdown_default_executor()


@asynccontextmanager
async def serial_server() -> AsyncIterator[
    tuple[str, asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]]]
]:
    """Give the URL of a TCP server and, later, its side of the first connection."""
    peer: asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = (
        asyncio.get_running_loop().create_future()
    )

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer.set_result((reader, writer))

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    try:
        yield f"socket://127.0.0.1:{server.sockets[0].getsockname()[1]}", peer
    finally:
        if peer.done():
            peer.result()[1].close()
        server.close()
        await server.wait_closed()


async def test_a_socket_carries_bytes_both_ways_until_the_other_side_closes() -> None:
    async with serial_server() as (url, peer):
        port = await opener(url)()
        reader, writer = await peer

        port.write(b"request")
        assert await reader.readexactly(7) == b"request"
        writer.write(b"reply")
        assert await read(port, 5) == b"reply"

        writer.close()
        with pytest.raises(PortLostError, match="closed by the other side"):
            await port.read(until_s=asyncio.get_running_loop().time() + LONG_S)
        await settled(port)


async def test_a_socket_that_takes_no_more_bytes_is_lost_instead_of_waited_for() -> None:
    async with serial_server() as (url, peer):
        port = await opener(url)()
        await peer

        with pytest.raises(PortLostError, match="stuck"):
            write_often(port, bytes(65536))

        await settled(port)


async def test_a_refused_connection_is_told() -> None:
    async with serial_server() as (url, _):
        pass

    with pytest.raises(PortError, match="is the serial server on"):
        await opener(url)()


async def test_a_connection_that_nobody_accepts_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    async def never(*_: object) -> None:
        await asyncio.Event().wait()

    monkeypatch.setattr(asyncio.get_running_loop(), "create_connection", never)
    monkeypatch.setattr(serial_port, "OPEN_LIMIT_S", 0.01)

    with pytest.raises(PortError, match="no connection within"):
        await opener("socket://192.0.2.1:502")()


@pytest.mark.parametrize("framing", ["8N1", "8N2", "8E1", "8O1"])
async def test_rate_and_framing_are_set_and_the_control_lines_left_low(
    pty: Pty, framing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = Framing.parse(framing)
    monkeypatch.setattr(serial_port, "_PSEUDO_TERMINALS", ())

    device = opener(pty.path, 9600, asked)._open_device()

    assert device.baudrate == 9600
    assert device.parity == asked.parity
    assert device.stopbits == asked.stop_bits
    assert not device.rts
    assert not device.dtr
    attributes = termios.tcgetattr(device.fileno())
    assert bool(attributes[2] & termios.CSTOPB) == (asked.stop_bits == 2)
    assert attributes[4] == termios.B9600
    device.close()
