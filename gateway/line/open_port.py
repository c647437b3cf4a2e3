"""Ports that are open: bytes taken with as few wake-ups as possible, waits that end on time.

What pyserial-asyncio 0.6 leaves open is closed here: it reads through select() and writes a loop's turn late,
so bytes go to and from the descriptor directly; its graceful close may never end, so ports are aborted.
"""

from __future__ import annotations

import abc
import asyncio
import contextlib
import fcntl
import os
import termios
from math import inf
from typing import cast

import serial

from gateway.errors import PortLostError
from gateway.line.lead import Lead
from gateway.line.uart import uart_errors
from gateway.line.wakeup import Wakeup

KEPT_BYTES = 4096  # unread; more than the longest frame many times over
DOZE_FROM = 3  # bytes still lacking from which on their arrival one by one is not watched

_READ_SIZE = 4096
_AT_ONCE_S = 0.00004
_AWAKE_S = 0.00005  # before the last byte but one is there: waking up takes a little longer
_CLOSED_BY_OTHER = "lost: closed by the other side"


class OpenPort(asyncio.Protocol, abc.ABC):
    """A Port that is fed by an asyncio transport."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._loop = asyncio.get_running_loop()
        self._time = self._loop.time
        self._transport: asyncio.Transport | None = None
        self._received = bytearray()
        self._wanted = 1  # bytes for which whoever reads is woken
        self._last_byte_s = -inf
        self._waiter: Wakeup | None = None
        self._lead = Lead()  # a read ends so long before its time; what wakes it is about as late
        self._hold_s = -inf  # until then nothing is written
        self._lost: str | None = None  # the reason
        self._closed = asyncio.Event()

    @property
    def last_byte_s(self) -> float:
        """When the latest bytes were handed over by the driver, which is never before they arrived."""
        return self._last_byte_s

    @abc.abstractmethod
    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the wire; raise PortLostError when the port is gone or stuck."""

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        """Return what has arrived, once it is `count` bytes or right before `until_s`; b"" when nothing came.

        A write that follows waits for the rest of the time, so that all that is done between the two is free.
        """
        while len(self._received) < count:
            if self._lost is not None:
                if not self._received:
                    raise PortLostError(self._name, self._lost)
                break
            if until_s - self._time() <= self._lead.seconds:
                self._look_once()
                self._hold_s = until_s
                break
            if await self._wait(until_s - self._lead.seconds, count):
                self._lead.learn(until_s - self._time())
        chunk = bytes(self._received)
        self._received.clear()
        return chunk

    def close(self) -> None:
        """Give the port up at once, unsent bytes included."""
        self._lost = self._lost or "closed"
        if self._transport is not None and not self._transport.is_closing():
            self._transport.abort()

    def uart_errors(self) -> dict[str, int] | None:
        """Return what the UART has counted; None where nothing does."""
        return None

    async def wait_closed(self) -> None:
        """Return once the descriptor is closed."""
        await self._closed.wait()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the transport; asyncio calls this."""
        self._transport = cast(asyncio.Transport, transport)
        if self._lost is not None:  # closed before it was quite open
            self._transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Hear that the port is gone; asyncio calls this, right before it closes the descriptor."""
        self._lost = self._lost or (f"lost: {exc}" if exc else _CLOSED_BY_OTHER)
        self._loop.call_soon(self._wake)  # not from within the transport's own end
        self._loop.call_soon(self._closed.set)

    def _take(self, data: bytes, asked_s: float) -> None:
        """Keep bytes that have just been handed over, the driver being asked for them at `asked_s`."""
        now_s = self._time()
        # What is here was here when we asked, unless that took us so long that more can have come meanwhile.
        self._last_byte_s = asked_s if now_s - asked_s < _AT_ONCE_S else now_s
        self._received += data
        del self._received[:-KEPT_BYTES]

    def _hold(self) -> None:
        """Wait for the end of a read that ended early without letting go: no sleep ends as exactly."""
        time, until_s = self._time, self._hold_s
        while time() < until_s:
            pass

    @abc.abstractmethod
    def _look_once(self) -> None:
        """Take what has arrived, without waiting."""

    async def _wait(self, until_s: float, count: int) -> bool:
        """Wait until then, or for so many bytes; return whether it was the time that ended it."""
        self._wanted = count
        self._waiter = Wakeup(self._loop)
        self._await_rest()
        timer = self._loop.call_at(until_s, self._wake)
        try:
            await self._waiter
        finally:
            timer.cancel()
            self._waiter = None
            self._wanted = 1
        return len(self._received) < count and self._lost is None

    def _await_rest(self) -> None:
        """Prepare for bytes that are awaited from now on, some of which may be under way."""

    def _wake(self) -> None:
        if self._waiter is not None:
            self._waiter.wake()


class TtyPort(OpenPort):
    """A tty. While a reply comes byte by byte it is looked at only now and then."""

    def __init__(self, name: str, device: serial.Serial, *, character_s: float) -> None:
        super().__init__(name)
        self._device = device
        self._fd = device.fileno()
        self._character_s = character_s
        self._is_watched = False  # the loop tells each arrival
        self._look_timer: asyncio.TimerHandle | None = None
        self._count = bytearray(4)  # for the driver's answer: bytes that wait

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the transport; asyncio calls this, and gives it the descriptor right afterwards."""
        super().connection_made(transport)
        if self._lost is None:
            with contextlib.suppress(termios.error):  # gone already: the first read will tell
                attributes = termios.tcgetattr(self._fd)
                attributes[6][termios.VMIN] = 1  # or an empty read could mean both "nothing yet" and "gone"
                termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
            self._loop.call_soon(self._take_over)

    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the wire; raise PortLostError when the port is gone or stuck."""
        if self._lost is not None:
            raise PortLostError(self._name, self._lost)
        self._hold()
        try:
            count = os.write(self._fd, frame)
        except BlockingIOError:
            count = 0
        except OSError as error:
            raise PortLostError(self._name, f"lost: {error.strerror}") from error
        if count != len(frame):
            raise PortLostError(self._name, "stuck: takes no more bytes", "unplug the adapter")

    def close(self) -> None:
        """Give the tty up at once; what it has not sent is dropped, or closing would wait for it."""
        self._look_away()
        with contextlib.suppress(OSError, termios.error):
            self._device.reset_output_buffer()
            # A pseudo terminal that others hold open would refuse us the next time else.
            fcntl.ioctl(self._device.fileno(), termios.TIOCNXCL)
        super().close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Hear that the tty is gone; asyncio calls this."""
        self._look_away()
        super().connection_lost(exc)

    def uart_errors(self) -> dict[str, int] | None:
        """Return what the UART has counted; None where its driver does not."""
        return uart_errors(self._fd) if self._lost is None else None

    def _take_over(self) -> None:
        """Read in the transport's place."""
        if self._lost is None:
            cast(asyncio.Transport, self._transport).pause_reading()
            self._watch()

    def _on_readable(self) -> None:
        self._fetch()
        if len(self._received) >= self._wanted or self._lost is not None:
            self._wake()
        elif self._waiter is not None:
            self._await_rest()

    def _await_rest(self) -> None:
        """Sleep until all but the last of the bytes can be there that lack: each of them would wake us."""
        lacking = self._wanted - len(self._received)
        if lacking < DOZE_FROM:
            return
        awake_s = self._last_byte_s + (lacking - 1) * self._character_s - _AWAKE_S
        if awake_s > self._time():
            self._look_away()
            self._look_timer = self._loop.call_at(awake_s, self._look)

    def _look_once(self) -> None:
        """Take what has arrived, without waiting; a read that finds nothing raises, which costs more."""
        if self._lost is None:
            with contextlib.suppress(OSError):  # the read, or else the write, will tell
                fcntl.ioctl(self._fd, termios.FIONREAD, self._count)
                if not any(self._count):
                    return
        self._fetch()

    def _fetch(self) -> None:
        if self._lost is not None or self._transport is None:
            return  # gone, or not quite open: until then an empty read means nothing
        asked_s = self._time()
        try:
            data = os.read(self._fd, _READ_SIZE)
        except BlockingIOError:
            return
        except OSError as error:
            self._give_up(f"lost: {error.strerror}")
            return
        if data:
            self._take(data, asked_s)
        else:
            self._give_up(_CLOSED_BY_OTHER)

    def _give_up(self, reason: str) -> None:
        self._lost = reason
        self._look_away()
        cast(asyncio.Transport, self._transport).abort()

    def _look(self) -> None:
        """Look at the tty again, and go on watching."""
        self._watch()
        self._on_readable()

    def _watch(self) -> None:
        self._look_timer = None
        self._loop.add_reader(self._fd, self._on_readable)
        self._is_watched = True

    def _look_away(self) -> None:
        if self._look_timer is not None:
            self._look_timer.cancel()
            self._look_timer = None
        if self._is_watched:
            self._loop.remove_reader(self._fd)
            self._is_watched = False


class SocketPort(OpenPort):
    """A TCP connection to a serial server."""

    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the connection; raise PortLostError when it is gone or stuck."""
        if self._lost is not None:
            raise PortLostError(self._name, self._lost)
        self._hold()
        transport = cast(asyncio.Transport, self._transport)
        if transport.get_write_buffer_size() > 0:
            raise PortLostError(self._name, "stuck: takes no more bytes", "restart the serial server")
        transport.write(frame)

    def data_received(self, data: bytes) -> None:
        """Take bytes; asyncio calls this."""
        self._take(data, self._time())
        if len(self._received) >= self._wanted:
            self._wake()

    def _look_once(self) -> None:
        """Leave it to the transport: what came in the last moment is read by the next wait."""
