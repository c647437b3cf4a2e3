"""How an accepted command is written and read back."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.families.reading import reads_for
from gateway.line.rtu.outcome import Outcome, Refused, Silent
from gateway.line.scheduler.requests import Priority
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.records import Phase, Record
from gateway.starters.commands.starter_io import StarterIo
from tests.starters.fakes import AT_SPEED, VB01
from tests.starters.rig import virtually
from tests.starters.rules import (
    ACCEPTED,
    CONFIRMED,
    WRITTEN,
    false_reading,
    ignore,
    lost_answer,
    once,
    ready,
    refuse,
)


@virtually
async def test_a_start_is_accepted_written_and_confirmed_by_what_is_read_back() -> None:
    rig = await ready()

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]
    assert rig.starts() == 1
    assert "running" in rig.sink.states()


@virtually
async def test_a_start_without_answer_is_written_once_and_ends_unconfirmed() -> None:
    rig = await ready()

    with rig.line.silence(WriteCoil):
        rig.submit("start")
        await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "not_seen")]
    assert "may be turning" in rig.sink.final().text
    assert rig.starts() == 1


@virtually
async def test_a_start_whose_answer_is_lost_is_confirmed_by_the_running_motor() -> None:
    rig = await ready()
    rig.line.rules.append(lambda request: lost_answer(rig, request))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]
    assert rig.starts() == 1


@virtually
async def test_a_starter_that_ignores_a_start_silently_leaves_it_unconfirmed() -> None:
    rig = await ready()
    rig.unit.on_write = ignore

    rig.submit("start")
    await asyncio.sleep(20.0)

    assert rig.sink.final().code == "not_seen"
    assert "then it was seen to stand, and run = 0 was written" in rig.sink.final().text
    assert rig.starts() == 1
    assert rig.line.writes[-1] == WriteCoil(100, is_on=False)


@virtually
async def test_a_start_is_not_taken_back_while_its_starter_cannot_be_read() -> None:
    rig = await ready()
    rig.unit.on_write = lambda _: rig.line.rules.append(lambda _: Silent("its cable is cut"))

    rig.submit("start")
    await asyncio.sleep(20.0)

    assert rig.sink.final().code == "not_seen"
    assert rig.starts() == 1
    assert len(rig.line.writes) == 1


@virtually
async def test_a_motor_that_runs_late_but_in_time_is_confirmed() -> None:
    rig = await ready()
    rig.unit.on_write = ignore
    rig.submit("start")
    await asyncio.sleep(2.5)
    rig.unit.holding[VB01] = AT_SPEED

    await asyncio.sleep(1.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


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
async def test_a_refused_start_has_failed() -> None:
    rig = await ready()
    rig.line.rules.append(refuse(WriteCoil, 3))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("failed", "illegal_data_value")]


@virtually
async def test_a_start_that_the_starter_says_it_is_still_working_on_is_read_back() -> None:
    rig = await ready()
    rig.line.rules.append(refuse(WriteCoil, 5))
    rig.submit("start")
    await asyncio.sleep(1.0)
    rig.unit.holding[VB01] = AT_SPEED

    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]


@pytest.mark.parametrize("exception", [6, 10, 11])
@virtually
async def test_a_refused_start_that_acts_all_the_same_is_confirmed(exception: int) -> None:
    rig = await ready()
    rig.line.rules.append(refuse(WriteCoil, exception))
    rig.submit("start")
    await asyncio.sleep(1.0)
    rig.unit.holding[VB01] = AT_SPEED

    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]


@pytest.mark.parametrize(
    ("exception", "code"),
    [
        (6, "server_device_busy"),
        (10, "gateway_path_unavailable"),
        (11, "gateway_target_device_failed_to_respond"),
    ],
)
@virtually
async def test_a_refused_start_has_failed_once_the_motor_was_seen_to_stand_and_run_to_be_0(
    exception: int, code: str
) -> None:
    rig = await ready()
    rig.line.rules.append(lambda r: Refused(exception, 0.0) if r == WriteCoil(100, is_on=True) else None)

    rig.submit("start")
    await asyncio.sleep(10.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("failed", code)]
    assert rig.line.writes == [WriteCoil(100, is_on=True), WriteCoil(100, is_on=False)]


@virtually
async def test_a_refused_start_of_a_starter_that_cannot_be_read_then_is_unconfirmed() -> None:
    rig = await ready()

    def rule(request: Request) -> Outcome | None:
        is_begun = bool(rig.line.writes)
        return (Refused(6, 0.0) if request.is_write else Silent()) if is_begun else None

    rig.line.rules.append(rule)
    rig.submit("start")
    await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "server_device_busy")]
    assert "the motor may be turning" in rig.sink.final().text


@virtually
async def test_a_setting_that_is_refused_as_busy_has_failed_at_once() -> None:
    rig = await ready()
    rig.line.rules.append(refuse(WriteRegister, 6))

    rig.submit("set", args={"parameter": "P314", "value": 30})
    await asyncio.sleep(1.0)

    assert rig.sink.phases() == [ACCEPTED, ("failed", "server_device_busy")]


@virtually
async def test_a_write_that_could_not_be_sent_is_a_rejection() -> None:
    rig = await ready()
    rig.line.rules.append(lambda r: Silent("port closed", is_sent=False) if r.is_write else None)

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("rejected", "line_down")]


@virtually
async def test_lost_read_backs_do_not_hinder_a_confirmation() -> None:
    rig = await ready()
    rig.submit("start")
    await asyncio.sleep(0.05)
    rig.line.rules.append(once(lambda request: Silent()))

    await asyncio.sleep(5.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


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
