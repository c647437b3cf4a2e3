"""Two serial ports joined by a null-modem cable, made of two pseudo-terminals."""

from __future__ import annotations

import contextlib
import os
import selectors
import threading
import tty
from types import TracebackType


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
        self._wake_r, self._wake_w = os.pipe()
        self._thread = threading.Thread(target=self._copy, daemon=True)

    def __enter__(self) -> PtyPair:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        os.write(self._wake_w, b"x")
        self._thread.join()
        for fd in (*self._masters, *self._slaves, self._wake_r, self._wake_w):
            with contextlib.suppress(OSError):
                os.close(fd)

    def _copy(self) -> None:
        with selectors.DefaultSelector() as selector:
            left, right = self._masters
            selector.register(left, selectors.EVENT_READ, right)
            selector.register(right, selectors.EVENT_READ, left)
            selector.register(self._wake_r, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    if key.fd == self._wake_r:
                        return
                    os.write(key.data, os.read(key.fd, 4096))
