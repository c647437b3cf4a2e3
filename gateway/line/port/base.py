"""The seam between a line and whatever carries its bytes: a tty, a socket, or a simulated line."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


class Port(Protocol):
    """An open, half-duplex byte port. Exactly one task uses it.

    Times are seconds on the clock of the running loop (`loop.time()`).
    """

    @property
    def last_byte_s(self) -> float:
        """When the latest byte received so far had arrived; minus infinity before the first."""
        ...

    def write(self, frame: bytes) -> None:
        """Hand one whole frame to the wire, at once; raise PortLostError when the port is gone.

        When the read before ended a moment before its time, the frame waits for that time.
        """
        ...

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        """Return what has arrived, waiting for at least one byte until `until_s`; b"" when none came.

        A port may wait for `count` bytes before it wakes its caller, but need not. It may end a wait in which
        nothing came some 0.1 ms early.
        Raises PortLostError when the port is gone.
        """
        ...

    def close(self) -> None:
        """Give the port up at once, unsent bytes included; never waits, may be called twice."""
        ...


class PortOpener(Protocol):
    """Opens the same port each time it is called."""

    @property
    def name(self) -> str:
        """The port as the configuration names it."""
        ...

    async def __call__(self) -> Port:
        """Open the port; raise PortError with the reason and a hint when it cannot be opened."""
        ...


@runtime_checkable
class HoldsBack(Protocol):
    """A port whose `write` waits for the end of the read before; `hold` does that waiting alone."""

    def hold(self) -> None:
        """Return when a frame may be written without further waiting."""
        ...


@runtime_checkable
class DeliversLate(Protocol):
    """A port whose bytes may reach the other side long after `write`: a TCP connection that stands still."""

    def reset(self) -> None:
        """Close it in such a way that nothing which has not left this machine does so later."""
        ...


@runtime_checkable
class ClosesLate(Protocol):
    """An opener whose port is not quite closed when `close` returns, and cannot be opened by others yet."""

    async def wait_closed(self) -> None:
        """Return once the port that was opened last is closed; `close` must have been called."""
        ...
