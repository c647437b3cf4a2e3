"""A virtual line on a pseudo terminal in real time: any Modbus master can open it like a serial port."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import hashlib
import os
import socket
import termios
import tty
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from gateway.errors import PortError
from gateway.modbus import LineTiming
from gateway.sim.bus.bus import Bus

_READ_SIZE = 4096
_RATES: dict[int, int] = {  # bit/s -> what termios calls it
    rate: getattr(termios, f"B{rate}") for rate in (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
}
_BAUDS = {rate: baud for baud, rate in _RATES.items()}


class PtyLine:
    """Serves a line on a pty of the running loop; `link` is a path that shall lead to it.

    The master sends at the rate and with the stop bits that it has set on its end; without that, the
    line's own apply. A pty has no parity (the kernel takes the flag away), so that is always the line's.

    A pty carries bytes at once: the line computes when they would have left the wire, and replies are written
    at the time of their last byte (or of each, as the line's `chunk_bytes` says). Give the line a tolerance
    of some 0.2 ms, since two programs never wake on the spot.
    """

    def __init__(self, line: Bus, *, link: str | os.PathLike[str] | None = None) -> None:
        self.line = line
        self.path = ""  # of the master's end, once started
        self.lost_bytes = 0  # written while no master read
        self._link = Path(link) if link is not None else None
        self._ours = -1
        self._theirs = -1  # stays open: without any opener our end could not be read
        self._claim: socket.socket | None = None  # of the link, as long as this process lives

    async def start(self) -> None:
        """Open the pty and serve it; PortError when the link cannot be made."""
        self._ours, self._theirs = os.openpty()
        self._set_up()
        os.set_blocking(self._ours, False)
        self.path = os.ttyname(self._theirs)
        try:
            self._make_link()
        except OSError as error:
            self._close()
            if error.errno == errno.EADDRINUSE:
                what = "another simulator serves this link"
                raise PortError(str(self._link), what, "end that one, or choose another path") from error
            raise PortError(str(self._link), error.strerror or "no link", "choose another path") from error
        self.line.attach(self._write)
        asyncio.get_running_loop().add_reader(self._ours, self._read)

    async def stop(self) -> None:
        """Close the pty and take the link away; may be called twice."""
        if self._ours < 0:
            return
        asyncio.get_running_loop().remove_reader(self._ours)
        self.line.detach()
        if self._link is not None and self._link.is_symlink() and os.readlink(self._link) == self.path:
            self._link.unlink()
        self._close()

    def _read(self) -> None:
        with suppress(OSError):  # a master that opened it exclusively may be killed and started again
            fcntl.ioctl(self._theirs, termios.TIOCNXCL)
        with suppress(BlockingIOError):
            self.line.send(os.read(self._ours, _READ_SIZE), self._timing())

    def _set_up(self) -> None:
        """Give the master's end the line's rate and stop bits."""
        tty.setraw(self._theirs)
        attributes = termios.tcgetattr(self._theirs)
        timing = self.line.timing
        rate = _RATES.get(timing.baud, attributes[5])
        attributes[2] &= ~termios.CSTOPB
        if timing.framing.stop_bits == 2:
            attributes[2] |= termios.CSTOPB
        attributes[4] = attributes[5] = rate
        termios.tcsetattr(self._theirs, termios.TCSANOW, attributes)

    def _timing(self) -> LineTiming:
        """Return the master's present speed and framing."""
        attributes = termios.tcgetattr(self._theirs)
        own = self.line.timing
        baud = _BAUDS.get(attributes[5], own.baud)
        framing = replace(own.framing, stop_bits=2 if attributes[2] & termios.CSTOPB else 1)
        return LineTiming(baud, framing)

    def _write(self, chunk: bytes, _arrival_s: float) -> None:
        """Hand bytes to the master; what does not fit its buffer is lost, as in a UART's."""
        written = 0
        with suppress(BlockingIOError):
            written = os.write(self._ours, chunk)
        self.lost_bytes += len(chunk) - written

    def _make_link(self) -> None:
        if self._link is None:
            return
        self._claim = _claimed(self._link)
        if self._link.is_symlink() and _is_stale(self._link):
            self._link.unlink()
        self._link.symlink_to(self.path)

    def _close(self) -> None:
        for end in (self._ours, self._theirs):
            os.close(end)
        if self._claim is not None:
            self._claim.close()
            self._claim = None
        self._ours = self._theirs = -1


def _claimed(link: Path) -> socket.socket:
    """Return what marks a link as ours until this process ends; OSError while it is another's."""
    name = hashlib.sha256(os.fsencode(link.absolute())).hexdigest()
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f"\0starter-gateway-simulated-line-{name}")
    except OSError:
        claim.close()
        raise
    return claim


def _is_stale(link: Path) -> bool:
    """Return whether a link is left over from a run that was killed: to a pty, or to nothing."""
    return not link.exists() or os.readlink(link).startswith("/dev/pts/")
