"""Commands of several steps, of none, and what can go wrong between them."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import replace

import pytest

from gateway.families.command.build import build
from gateway.line.rtu.outcome import Refused, Silent
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.records import Phase
from gateway.starters.commands import execution as execution
from gateway.starters.commands import starter_io as wire
from tests.starters.fakes import FAULT, READY, VB01
from tests.starters.rig import virtually
from tests.starters.rules import (
    ACCEPTED,
    WRITTEN,
    broken,
    forget_coil_2,
    ready,
)

UNDO_START = WriteCoil(0, False)


@virtually
async def test_a_command_that_cannot_be_read_back_stays_unconfirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = await ready()
    monkeypatch.setattr(execution, "build", lambda *args, **more: replace(build(*args, **more), verify=None))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "not_readable")]


@virtually
async def test_an_error_inside_before_the_write_ends_as_failed(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    rig = await ready()
    monkeypatch.setattr(wire, "rows_in", broken)

    with caplog.at_level(logging.ERROR):
        rig.submit("start")
        await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("failed", "internal")]
    assert "ended by a bug" in caplog.text
    assert rig.line.writes == []


@virtually
async def test_an_error_inside_after_the_write_leaves_the_command_unconfirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = await ready()
    rig.unit.on_write = lambda request: monkeypatch.setattr(wire, "rows_in", broken)

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "internal")]


@virtually
async def test_a_reset_stops_after_a_first_write_that_was_not_answered() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = READY | FAULT

    with rig.line.silence(WriteCoil):
        rig.submit("reset")
        await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "no_answer")]
    assert len(rig.line.writes) == 1


@virtually
async def test_a_reset_refused_at_its_second_write_has_failed() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = READY | FAULT
    rig.line.rules.append(lambda r: Refused(3, 0.0) if r == WriteCoil(107, True) else None)

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("failed", "illegal_data_value")]


@virtually
async def test_a_line_lost_between_two_writes_leaves_the_command_unconfirmed() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = READY | FAULT
    rig.line.rules.append(lambda r: Silent("port lost", is_sent=False) if r == WriteCoil(107, True) else None)

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "line_down")]


@virtually
async def test_an_sst_that_does_not_enter_its_configuration_mode_is_left_as_it_was() -> None:
    rig = await ready("sst")
    rig.line.rules.append(lambda r: forget_coil_2(rig, r))

    rig.submit("configure")
    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is Phase.UNCONFIRMED
    assert rig.line.writes == [UNDO_START, WriteCoil(1, True), WriteCoil(1, False), UNDO_START]


@virtually
async def test_an_sst_that_cannot_be_left_safe_is_unconfirmed_although_it_refused() -> None:
    rig = await ready("sst")
    rig.line.rules.append(lambda r: Refused(2, 0.0) if isinstance(r, WriteRegister) else None)
    rig.line.rules.append(lambda r: Silent() if r == WriteCoil(1, False) else None)

    rig.submit("configure", args={"R41": 60})
    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is Phase.UNCONFIRMED
    assert rig.sink.final().code == "illegal_data_address"


@virtually
async def test_an_sst_that_refuses_a_register_is_taken_out_of_configuration_mode() -> None:
    rig = await ready("sst")
    rig.line.rules.append(lambda r: Refused(3, 0.0) if isinstance(r, WriteRegister) else None)

    rig.submit("configure", args={"R41": 60})
    await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("failed", "illegal_data_value")]
    assert rig.line.writes[-2:] == [WriteCoil(1, False), UNDO_START]
