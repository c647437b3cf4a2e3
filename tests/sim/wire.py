"""Short words for talking to simulated units, with and without a line."""

from __future__ import annotations

import asyncio
from typing import Any

from gateway.modbus.pdu import Request
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.bus.port import SimulatedPort
from gateway.sim.core.unit import SimulatedUnit

TIMING = LineTiming(9600, Framing.parse("8N2"))


class Talk:
    """Asks one unit, without a line; time passes only on request."""

    def __init__(self, unit: SimulatedUnit) -> None:
        self.unit = unit
        self.now_s = 0.0
        unit.clock = lambda: self.now_s
        unit.advance(0.0)

    def wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.unit.advance(self.now_s)

    def pdu(self, request: Request) -> bytes | None:
        return self.unit.handle(request.encode(), self.now_s)

    def ask(self, request: Request) -> Any:
        """Return the decoded answer; fails on an exception or silence."""
        reply = self.pdu(request)
        assert reply is not None, "silence"
        return request.decode_reply(reply)


async def receive(port: SimulatedPort, *, within_s: float) -> bytes:
    """Return all that arrives until so long from now."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + within_s
    received = bytearray()
    while loop.time() < until_s:
        received += await port.read(until_s=until_s)
    return bytes(received)
