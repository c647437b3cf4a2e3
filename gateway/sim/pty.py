"""A virtual line on a pseudo terminal in real time: any Modbus master can open it like a serial port."""

from __future__ import annotations

import asyncio
import fcntl
import os
import termios
import tty
from contextlib import suppress
from pathlib import Path

from gateway.errors import PortError
from gateway.sim.bus import Bus

_READ_SIZE = 4096


class PtyLine:
    """Serves a line on a pty of the running loop; `link` is a path that shall lead to it.

    A pty carries bytes at once: the line reckons when they would have left the wire, and replies are written
    at the time of their last byte (or of each, as the line's `chunk_bytes` says). Give the line a tolerance
    of some 0.2 ms, since two programs never wake on the spot.
    """

    def __init__(self, line: Bus, *, link: str | os.PathLike[str] | None = None) -> None:
        self.line = line
        self.path = ""  # of the master's end, once started
        self.lost_bytes = 0  # written while nobody read
        self._link = Path(link) if link is not None else None
        self._ours = -1
        self._theirs = -1  # kept open: without any opener our end could not be read

    async def start(self) -> None:
        """Open the pty and serve it; PortError when the link cannot be made."""
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.path = os.ttyname(self._theirs)
        try:
            self._make_link()
        except OSError as error:
            self._close()
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
        with suppress(OSError):  # whoever opened it exclusively may be killed, and wants it back then
            fcntl.ioctl(self._theirs, termios.TIOCNXCL)
        with suppress(BlockingIOError):
            self.line.send(os.read(self._ours, _READ_SIZE))

    def _write(self, chunk: bytes, _arrival_s: float) -> None:
        """Hand bytes to the master; what does not fit its buffer is lost, as in a UART's."""
        written = 0
        with suppress(BlockingIOError):
            written = os.write(self._ours, chunk)
        self.lost_bytes += len(chunk) - written

    def _make_link(self) -> None:
        if self._link is None:
            return
        if self._link.is_symlink() and _is_stale(self._link):
            self._link.unlink()
        self._link.symlink_to(self.path)

    def _close(self) -> None:
        for end in (self._ours, self._theirs):
            os.close(end)
        self._ours = self._theirs = -1


def _is_stale(link: Path) -> bool:
    """Return whether a link is left over from a run that was killed: to a pty, or to nothing."""
    return not link.exists() or os.readlink(link).startswith("/dev/pts/")
