"""A thread that copies what is read from some file descriptors to others."""

from __future__ import annotations

import os
import selectors
import threading
from collections.abc import Callable, Mapping


class FdCopier:
    """Copies from each descriptor to the one that `routes` gives; `see` gets everything first."""

    def __init__(
        self, routes: Mapping[int, int], see: Callable[[int, bytes], None] = lambda *_: None
    ) -> None:
        self._routes = routes
        self._see = see
        self._wake_r, self._wake_w = os.pipe()
        self._thread = threading.Thread(target=self._copy, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End; nothing is copied after this."""
        os.write(self._wake_w, b"x")
        self._thread.join(10.0)
        os.close(self._wake_r)
        os.close(self._wake_w)

    def _copy(self) -> None:
        with selectors.DefaultSelector() as selector:
            for fd in (*self._routes, self._wake_r):
                selector.register(fd, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    if key.fd == self._wake_r:
                        return
                    octets = os.read(key.fd, 4096)
                    self._see(key.fd, octets)
                    os.write(self._routes[key.fd], octets)
