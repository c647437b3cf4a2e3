"""An open tty: bytes taken with as few wake-ups as possible.

The gaps of pyserial-asyncio 0.6 are closed here: it reads through select() and writes one round of the
loop late, so bytes go to and from the descriptor directly; its graceful close may never end, so ports are
aborted.

`uart_errors` are the UART's own counts, by which a bad line differs from a mute starter.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import struct
import termios
from collections.abc import Callable
from typing import Any, Protocol, cast, runtime_checkable

import serial

from gateway.errors import PortLostError
from gateway.line.port.buffered import CLOSED_BY_OTHER, OpenPort

_TIOCGICOUNT = 0x545D  # [linux/asm-generic/ioctls.h]
_ICOUNTER = struct.Struct("20i")  # struct serial_icounter_struct [linux/serial.h]: 11 counters, 9 reserved
_PLACES = {"frame": 6, "overrun": 7, "parity": 8, "break": 9, "buffer_overrun": 10}
DOZE_FROM = 3  # bytes still lacking from which on their arrival one by one is not watched
_READ_SIZE = 4096
_AWAKE_S = 0.00005  # before the last byte but one is there: waking up takes a little longer


@runtime_checkable
class CountsErrors(Protocol):
    """An opener that may know what the UART of its open port has counted."""

    def uart_errors(self) -> dict[str, int] | None:
        """Return the counters since the driver began; None where there are none."""
        ...


def uart_errors(fd: int, ioctl: Callable[..., Any] = fcntl.ioctl) -> dict[str, int] | None:
    """Return the error counters of a tty; None where its driver has none, or the tty is gone."""
    try:
        answer = ioctl(fd, _TIOCGICOUNT, bytes(_ICOUNTER.size))
    except OSError:
        return None
    counters = _ICOUNTER.unpack(answer)
    return {name: counters[place] for name, place in _PLACES.items()}


class TtyPort(OpenPort):
    """A tty. While a reply comes byte by byte it is looked at only now and then."""

    def __init__(self, name: str, device: serial.Serial, *, character_s: float) -> None:
        super().__init__(name)
        self._device = device
        self._fd = device.fileno()
        self._character_s = character_s
        self._is_watched = False  # the loop reports each arrival
        self._look_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the transport; asyncio calls this, and gives it the descriptor right afterwards."""
        super().connection_made(transport)
        if self._lost is None:
            with contextlib.suppress(termios.error):  # gone already: the first read will show it
                attributes = termios.tcgetattr(self._fd)
                attributes[6][termios.VMIN] = 1  # or an empty read could mean both "nothing yet" and "gone"
                termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
            self._loop.call_soon(self._replace_reader)

    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the wire; raise PortLostError when the port is gone or stuck."""
        if self._lost is not None:
            raise PortLostError(self._name, self._lost)
        self.hold()
        try:
            count = os.write(self._fd, frame)
        except BlockingIOError:
            count = 0
        except OSError as error:
            raise PortLostError(self._name, f"lost: {error.strerror}") from error
        if count != len(frame):
            raise PortLostError(self._name, "stuck: accepts no further bytes", "unplug the adapter")

    def close(self) -> None:
        """Give the tty up at once; unsent bytes are dropped, or closing would wait for them."""
        self._look_away()
        with contextlib.suppress(OSError, termios.error):
            self._device.reset_output_buffer()
            # A terminal that others hold open as well would refuse us the next time else.
            fcntl.ioctl(self._device.fileno(), termios.TIOCNXCL)
        super().close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that the tty is gone; asyncio calls this."""
        self._look_away()
        super().connection_lost(exc)

    def uart_errors(self) -> dict[str, int] | None:
        """Return what the UART has counted; None where its driver does not."""
        return uart_errors(self._fd) if self._lost is None else None

    def _replace_reader(self) -> None:
        """Read in the transport's place."""
        if self._lost is None:
            cast(asyncio.Transport, self._transport).pause_reading()
            self._watch()

    def _on_readable(self) -> None:
        """Take the bytes that have arrived, at the moment when that is known: the silence begins then."""
        self._look_once()
        if len(self._received) >= self._wanted or self._lost is not None:
            self._wake()
        elif self._waiter is not None:
            self._await_rest()

    def _await_rest(self) -> None:
        """Sleep until all but the last of the bytes can be there that lack: each of them would wake us."""
        lacking = self._wanted - len(self._received)
        if lacking < DOZE_FROM:
            return
        awake_s = self.last_byte_s + (lacking - 1) * self._character_s - _AWAKE_S
        if awake_s > self._time():
            self._look_away()
            self._look_timer = self._loop.call_at(awake_s, self._look)

    def _look_once(self) -> None:
        """Take what has arrived, without waiting."""
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
            self._give_up(CLOSED_BY_OTHER)

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
        self._loop.add_quick_reader(self._fd, self._on_readable)
        self._is_watched = True

    def _look_away(self) -> None:
        if self._look_timer is not None:
            self._look_timer.cancel()
            self._look_timer = None
        if self._is_watched:
            self._is_watched = False
            self._loop.remove_quick_reader(self._fd)
