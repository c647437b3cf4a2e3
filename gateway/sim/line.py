"""A virtual RS-485 line that the gateway can open in place of a tty."""

from __future__ import annotations

from gateway.errors import PortError
from gateway.modbus.timing import LineTiming
from gateway.sim.bus import Bus
from gateway.sim.port import SimulatedPort


class SimulatedLine(Bus):
    """A bus with an adapter that can be opened, pulled out and put back."""

    is_plugged_in = True
    opened = 0  # how often
    _port: SimulatedPort | None = None

    def opener(self, *, timing: LineTiming | None = None) -> SimulatedOpener:
        """Return what opens this line's port, set to the line's timing or to another one."""
        return SimulatedOpener(self, timing or self.timing)

    def open(self, timing: LineTiming) -> SimulatedPort:
        """Open the port; PortError while it is unplugged or in use."""
        if not self.is_plugged_in:
            raise PortError(self.name, "no such device", "plug the adapter in")
        if self._port is not None and self._port.is_open:
            raise PortError(self.name, "in use", "close the other program")
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
    """Opens a virtual line as often as asked (`gateway.line.port.PortOpener`)."""

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
