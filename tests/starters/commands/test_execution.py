"""How an accepted command is written and read back."""

from __future__ import annotations

import asyncio
from typing import Any

from gateway.families.reading import reads_for
from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.records import Phase, Record
from gateway.starters.commands.starter_io import StarterIo
from tests.starters.fakes import AT_SPEED, VB01
from tests.starters.rig import virtually
from tests.starters.rules import (
    ACCEPTED,
    false_reading,
    ignore,
    ready,
)


@virtually
async def test_one_reading_of_a_running_motor_does_not_confirm_a_start() -> None:
    rig = await ready()
    rig.unit.on_write = ignore
    rig.submit("start")
    await asyncio.sleep(1.0)
    rig.line.rules.append(false_reading(rig, AT_SPEED))

    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is Phase.UNCONFIRMED


@virtually
async def test_a_single_running_reading_at_the_very_end_gets_its_second() -> None:
    rig = await ready()
    rig.unit.on_write = ignore
    rig.submit("start")
    await asyncio.sleep(3.0)
    rig.unit.holding[VB01] = AT_SPEED

    await asyncio.sleep(5.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_a_write_that_could_not_be_sent_is_a_rejection() -> None:
    rig = await ready()
    rig.line.rules.append(lambda r: Silent("port closed", is_sent=False) if r.is_write else None)

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("rejected", "line_down")]


@virtually
async def test_the_next_request_goes_out_before_anything_is_published_of_the_rows_just_read() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = AT_SPEED
    order: list[str] = []
    transact, put = rig.line.transact, rig.sink.put

    def noting(*args: Any, **kwargs: Any) -> asyncio.Future[Outcome]:
        order.append("asked")
        return transact(*args, **kwargs)

    def keep(record: Record) -> None:
        order.append(type(record).__name__)
        put(record)

    rig.line.transact, rig.sink.put = noting, keep  # type: ignore[method-assign] # that is the point
    reads = reads_for(rig.telemetry.profile, ("VB01", "P003"))

    await StarterIo(rig.telemetry).read(reads, lane=Priority.COMMAND)
    await asyncio.sleep(0)

    assert len(reads) == 2
    assert order[:3] == ["asked", "asked", "StateRecord"]


@virtually
async def test_what_confirms_a_command_is_published_before_its_result() -> None:
    rig = await ready()

    for verb, state in (("start", "running"), ("stop", "ready")):
        rig.sink.clear()
        rig.submit(verb, verb)
        await asyncio.sleep(5.0)

        places = {
            getattr(record, "state", None) or getattr(record, "phase", None): place
            for place, record in enumerate(rig.sink.records)
        }
        assert places[state] < places[Phase.CONFIRMED]
