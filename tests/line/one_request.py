"""One request and its reply."""

from __future__ import annotations

from gateway.line.rtu.outcome import Outcome
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from tests.line.fakes import FakePort, Said, ask
from tests.virtual_time import run_virtually

READ = ReadHoldingRegisters(0x0100, 4)
READ_ADU = adu.encode(1, READ.encode())
REPLY = adu.encode(1, READ.encode_reply((1, 2, 3, 4)))


def outcome_after(*said: Said) -> Outcome:
    """Return what becomes of READ when this comes after it."""

    async def scenario() -> Outcome:
        return await ask(FakePort(lambda frame: said), READ)

    return run_virtually(scenario())
