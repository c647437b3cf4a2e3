"""Whether a received message is not dealt with yet; any thread may ask."""

from __future__ import annotations

import select


class Unread:
    """Of one connection after the other; everything but the question belongs to the loop that reads them."""

    def __init__(self) -> None:
        self._socket: select.poll | None = None
        self._is_being_read = False

    def __call__(self) -> bool:
        """Return whether something waits in the socket, or is being read; from one thread at a time."""
        if self._is_being_read:
            return True
        watched = self._socket
        return watched is not None and any(event & select.POLLIN for _, event in watched.poll(0))

    def watch(self, descriptor: int) -> None:
        """Ask this socket from now on."""
        watched = select.poll()
        watched.register(descriptor, select.POLLIN)
        self._socket = watched

    def forget(self) -> None:
        """Ask no socket: it is about to be closed."""
        self._socket = None

    def begin(self) -> None:
        """Note that the socket is about to be read."""
        self._is_being_read = True

    def end(self) -> None:
        """Note that what was read has been dealt with."""
        self._is_being_read = False
