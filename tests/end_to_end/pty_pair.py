"""Two serial ports joined by a null-modem cable, made of two pseudo-terminals."""

from __future__ import annotations

import contextlib
import os
import tty
from types import TracebackType

from tests.end_to_end.fd_copier import FdCopier


class PtyPair:
    """`left` and `right` are paths of ttys; what is written to one is read from the other."""

    def __init__(self) -> None:
        self._masters: list[int] = []
        self._slaves: list[int] = []
        for _ in range(2):
            master, slave = os.openpty()
            tty.setraw(slave)
            self._masters.append(master)
            self._slaves.append(slave)  # held open, so that a program that leaves does not hang the line up
        self.left, self.right = (os.ttyname(slave) for slave in self._slaves)
        left, right = self._masters
        self._copier = FdCopier({left: right, right: left})

    def __enter__(self) -> PtyPair:
        self._copier.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._copier.stop()
        for fd in (*self._masters, *self._slaves):
            with contextlib.suppress(OSError):
                os.close(fd)
