"""A virtual RS-485 line that the gateway opens in place of a tty: its port, the line and an opener."""

from __future__ import annotations

import asyncio

from gateway.errors import PortError, PortLostError
from gateway.modbus import LineTiming
from gateway.sim.bus.bus import Bus


class SimulatedPort:
    """An open virtual line (`gateway.line.port.base.Port`), used with this speed and framing."""

    def __init__(self, line: Bus, timing: LineTiming) -> None:
        self._line = line
        self._timing = timing
        self._received = bytearray()
        self._wanted = 1  # bytes for which the reader is woken
        self._last_byte_s = float("-inf")
        self._waiter: asyncio.Future[None] | None = None
        self._lost = ""  # why it can no longer be used
        line.attach(self._take)

    @property
    def last_byte_s(self) -> float:
        """When the latest byte received so far had arrived; minus infinity before the first."""
        self._line.inbox.deliver()
        return self._last_byte_s

    def write(self, frame: bytes) -> None:
        """Put one frame on the wires; PortLostError when the port is gone."""
        self._require_open()
        self._line.send(frame, self._timing)

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        """Return what has arrived, once it is `count` bytes or at `until_s`."""
        loop = asyncio.get_running_loop()
        self._require_open()
        self._line.inbox.deliver()
        if len(self._received) < count and loop.time() < until_s:
            self._wanted = count
            self._line.inbox.want(count - len(self._received))
            self._waiter = loop.create_future()
            timer = loop.call_at(until_s, self._wake)
            try:
                await self._waiter
            finally:
                timer.cancel()
                self._waiter = None
            self._require_open()
            self._line.inbox.deliver()
        received = bytes(self._received)
        self._received.clear()
        return received

    def close(self) -> None:
        """Give the port up; may be called twice."""
        if not self._lost:
            self.lose("closed")

    def lose(self, reason: str) -> None:
        """Make the port unusable: reading and writing then raise PortLostError with this reason."""
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
        if len(self._received) >= self._wanted:
            self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def _require_open(self) -> None:
        if self._lost:
            raise PortLostError(self._line.name, self._lost)


class SimulatedLine(Bus):
    """A bus with an adapter that can be opened, pulled out and put back."""

    is_plugged_in = True
    opened = 0  # how often
    _port: SimulatedPort | None = None

    def opener(self, *, timing: LineTiming | None = None) -> SimulatedOpener:
        """Return what opens this line's port, set to the line's timing or to another one."""
        return SimulatedOpener(self, timing or self.timing)

    def open(self, timing: LineTiming) -> SimulatedPort:
        """Open the port; PortError while it is unplugged or held."""
        if not self.is_plugged_in:
            raise PortError(self.name, "no such device", "plug the adapter in")
        if self._port is not None and self._port.is_open:
            raise PortError(self.name, "busy", "another program holds it: stop that one")
        self._port = SimulatedPort(self, timing)
        self.opened += 1
        return self._port

    def unplug(self) -> None:
        """Pull the adapter out: an open port is lost, and cannot be opened again."""
        self.is_plugged_in = False
        if self._port is not None and self._port.is_open:
            self._port.lose("unplugged")

    def plug_in(self) -> None:
        """Put the adapter back."""
        self.is_plugged_in = True


class SimulatedOpener:
    """Opens a virtual line as often as asked (`gateway.line.port.base.PortOpener`)."""

    def __init__(self, line: SimulatedLine, timing: LineTiming) -> None:
        self._line = line
        self._timing = timing

    @property
    def name(self) -> str:
        """The line's name."""
        return self._line.name

    async def __call__(self) -> SimulatedPort:
        """Open the port; PortError when it cannot be had."""
        return self._line.open(self._timing)
