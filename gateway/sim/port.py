"""The master's end of a virtual line: the same seam as a tty, without one."""

from __future__ import annotations

import asyncio

from gateway.errors import PortLostError
from gateway.modbus.timing import LineTiming
from gateway.sim.bus import Bus


class SimulatedPort:
    """An open virtual line (`gateway.line.port.Port`), spoken to with this speed and framing."""

    def __init__(self, line: Bus, timing: LineTiming) -> None:
        self._line = line
        self._timing = timing
        self._received = bytearray()
        self._last_byte_s = float("-inf")
        self._waiter: asyncio.Future[None] | None = None
        self._lost = ""  # why it can no longer be used
        line.attach(self._take)

    @property
    def last_byte_s(self) -> float:
        """When the latest byte received so far had arrived; minus infinity before the first."""
        return self._last_byte_s

    def write(self, frame: bytes) -> None:
        """Put one frame on the wires; PortLostError when the port is gone."""
        self._require_open()
        self._line.send(frame, self._timing)

    async def read(self, *, until_s: float, count: int = 1) -> bytes:  # noqa: ARG002 - no wake-up is worth saving here
        """Return what has arrived, waiting for at least one byte until `until_s`."""
        loop = asyncio.get_running_loop()
        self._require_open()
        if not self._received and loop.time() < until_s:
            self._waiter = loop.create_future()
            timer = loop.call_at(until_s, self._wake)
            try:
                await self._waiter
            finally:
                timer.cancel()
                self._waiter = None
            self._require_open()
        received = bytes(self._received)
        self._received.clear()
        return received

    def close(self) -> None:
        """Give the port up; may be called twice."""
        if not self._lost:
            self.lose("closed")

    def lose(self, reason: str) -> None:
        """Make the port unusable: whoever reads or writes gets PortLostError with this reason."""
        self._lost = reason
        self._line.detach()
        self._wake()

    @property
    def is_open(self) -> bool:
        """Whether it can still be used."""
        return not self._lost

    def _take(self, chunk: bytes, arrival_s: float) -> None:
        self._received += chunk
        self._last_byte_s = arrival_s
        self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def _require_open(self) -> None:
        if self._lost:
            raise PortLostError(self._line.name, self._lost)
