"""A line that is served for a while."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

from gateway.line.rtu.outcome import Silent
from gateway.line.scheduler.requests import Poll
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import LineTiming
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import TIMING, Answer, LineRig
from tests.virtual_time import run_virtually

READ = ReadHoldingRegisters(100, 2)
WRITE = WriteRegister(5003, 1)
NO_PORT = Silent("port closed", is_sent=False)


def run_for(seconds: float, answer: Answer, polls: Iterable[Poll], timing: LineTiming = TIMING) -> LineRig:
    """Serve a line for so long and return the rig with everything that was published."""
    rig = LineRig(answer, polls, timing)

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(seconds)

    run_virtually(scenario())
    return rig
