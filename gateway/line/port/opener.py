"""Opens real ports: a tty through pyserial-asyncio, or a TCP serial server.

pyserial-asyncio 0.6 reports a port as lost before it is closed, so reopening waits; pyserial uses select(),
so descriptors from 1024 on are refused.

A port belongs to the one process that holds its flock, which the kernel ends with that process. It is all
that pyserial's `exclusive` takes: it keeps out only programs that ask for it too. TIOCEXCL keeps out the
others, but belongs to the terminal and lasts until its last descriptor is closed. On a pseudo terminal (of
socat, ser2net) the other end holds it open: a killed gateway that is not root's would never be let in again.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import os
import stat
import termios

import serial
import serial_asyncio

from gateway.errors import PortError
from gateway.line.port.base import Port
from gateway.line.port.buffered import OpenPort
from gateway.line.port.tcp import connect
from gateway.line.port.tty import TtyPort
from gateway.modbus import Framing, LineTiming

OPEN_LIMIT_S = 5.0  # for the driver

_PSEUDO_TERMINALS = range(136, 144)  # majors of /dev/pts/* [Linux devices.txt]
_SELECT_LIMIT = 1024  # FD_SETSIZE
_PARITIES = {"N": serial.PARITY_NONE, "E": serial.PARITY_EVEN, "O": serial.PARITY_ODD}
_STOP_BITS = {1: serial.STOPBITS_ONE, 2: serial.STOPBITS_TWO}
_NO_SUCH_PORT = ("no such port", "plug the adapter in, or correct the name: see /dev/serial/by-id")
_NOT_PERMITTED = ("not permitted", "add the user to group dialout")
_BUSY = ("busy", "another program holds it: stop that one")
_NO_TTY = ("not a serial port", "name a device such as /dev/ttyUSB0, or socket://host:port")
_HINTS = {
    errno.ENOENT: _NO_SUCH_PORT,
    errno.ENODEV: _NO_SUCH_PORT,
    errno.ENXIO: _NO_SUCH_PORT,
    errno.EACCES: _NOT_PERMITTED,
    errno.EPERM: _NOT_PERMITTED,
    errno.EBUSY: _BUSY,
    errno.EAGAIN: _BUSY,
    errno.ENOTTY: _NO_TTY,
    errno.EIO: ("the device does not work", "unplug the adapter and plug it in again"),
}


class SerialOpener:
    """Opens one tty path or socket://host:port, again and again."""

    def __init__(self, name: str, baud: int, framing: Framing) -> None:
        self._name = name
        self._baud = baud
        self._framing = framing
        self._latest: OpenPort | None = None

    @property
    def name(self) -> str:
        """The port as the configuration names it."""
        return self._name

    def uart_errors(self) -> dict[str, int] | None:
        """Return what the UART of the open port has counted; None where nothing does."""
        return None if self._latest is None else self._latest.uart_errors()

    async def __call__(self) -> Port:
        """Open the port, once the one opened before is closed; PortError has the reason and a hint."""
        await self.wait_closed()
        self._latest = await (connect(self._name) if "://" in self._name else self._open_tty())
        return self._latest

    async def wait_closed(self) -> None:
        """Close the port that was opened last, and return once it is closed."""
        if self._latest is not None:
            self._latest.close()
            await self._latest.wait_closed()

    async def _open_tty(self) -> OpenPort:
        loop = asyncio.get_running_loop()
        opening = loop.run_in_executor(None, self._open_device)
        try:
            await asyncio.wait([opening], timeout=OPEN_LIMIT_S)
        finally:
            if not opening.done():
                opening.add_done_callback(_close_late)
        if not opening.done():
            raise PortError(self._name, f"does not open within {OPEN_LIMIT_S:g} s", "unplug the adapter")
        device = opening.result()
        port = TtyPort(self._name, device, character_s=LineTiming(self._baud, self._framing).character_s)
        await serial_asyncio.connection_for_serial(loop, lambda: port, device)
        return port

    def _open_device(self) -> serial.Serial:
        """Open and set up the tty; may block."""
        try:
            status = os.stat(self._name)
            if not stat.S_ISCHR(status.st_mode):
                raise PortError(self._name, *_NO_TTY)
            # A pseudo terminal has no parity; asked for it once more, tcsetattr fails with EINVAL.
            is_pseudo = os.major(status.st_rdev) in _PSEUDO_TERMINALS
            device = serial.Serial(
                baudrate=self._baud,
                parity=serial.PARITY_NONE if is_pseudo else _PARITIES[self._framing.parity],
                stopbits=_STOP_BITS[self._framing.stop_bits],
                exclusive=True,
            )
            device.rts = device.dtr = False  # raised lines may switch an adapter's driver on for good
            device.port = self._name
            device.open()
        except (OSError, ValueError, termios.error) as error:
            raise port_error(self._name, error) from error
        if max(device.fileno(), device.pipe_abort_read_r or 0) >= _SELECT_LIMIT:
            device.close()
            raise PortError(self._name, "too many open files", f"fewer than {_SELECT_LIMIT} can be served")
        with contextlib.suppress(
            OSError
        ):  # the flock is ours: leftovers of an earlier holder do not count any more
            fcntl.ioctl(device.fileno(), termios.TIOCNXCL if is_pseudo else termios.TIOCEXCL)
        with contextlib.suppress(OSError, ValueError, AttributeError):  # FTDI holds bytes back for 16 ms else
            device.set_low_latency_mode(True)
        return device


def port_error(name: str, error: BaseException) -> PortError:
    """Return the error that says in a user's words why a port did not open, with a hint."""
    number = _errno_of(error)
    if number in _HINTS:
        return PortError(name, *_HINTS[number])
    return PortError(name, str(error))


def _close_late(opening: asyncio.Future[serial.Serial]) -> None:
    """Close a tty that opened after the wait for it had ended."""
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


def _errno_of(error: BaseException | None) -> int | None:
    """Return the error number; pyserial hides some in the error that it was caused by."""
    while error is not None:
        if isinstance(error, OSError | termios.error) and error.args and isinstance(error.args[0], int):
            return error.args[0]
        error = error.__context__
    return None
