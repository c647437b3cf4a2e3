"""A port for oneself: without polls, or with reads only."""

from __future__ import annotations

import pytest

from gateway.line.direct import Survey, exclusive_line
from gateway.line.rtu.outcome import Answered, Silent
from gateway.line.scheduler.requests import Priority
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.factory import make_unit
from tests.starters.rig import virtually

TIMING = LineTiming(19200, Framing.parse("8N2"))
READ = ReadHoldingRegisters(5001, 1)


def make_bus() -> SimulatedLine:
    return SimulatedLine(TIMING, [make_unit("ssw07", 1)])


@virtually
async def test_a_port_that_is_lost_stays_lost() -> None:
    bus = make_bus()
    async with exclusive_line("pumps", bus.opener(), TIMING) as line:
        bus.unplug()
        await line.transact(1, READ, response_time_s=0.05, lane=Priority.READ_BACK)
        bus.plug_in()

        outcome = await line.transact(1, READ, response_time_s=0.05, lane=Priority.READ_BACK)

    assert isinstance(outcome, Silent)
    assert not outcome.is_sent
    assert bus.opened == 1


@virtually
async def test_a_survey_only_reads_and_closes_its_port() -> None:
    bus = make_bus()

    async with Survey(bus.opener(), TIMING) as survey:
        assert isinstance(await survey.ask(1, READ, response_time_s=0.05), Answered)
        with pytest.raises(ValueError, match="only reads"):
            await survey.ask(1, WriteRegister(220, 1), response_time_s=0.05)

    bus.open(TIMING).close()
    assert list(bus.unit(1).writes) == []
