from __future__ import annotations

import asyncio

import pytest

from gateway.line.rtu.outcome import Garbled, Outcome, Refused, Silent
from gateway.records import AvailabilityRecord, Quality, StateRecord, ValueRecord
from tests.starters.fakes import P003, READY
from tests.starters.rig import Rig, virtually

STATUS, VALUES = "pump-1/status:VB01", "pump-1/values:P002"
STALE = Quality.STALE


@virtually
async def test_a_value_is_published_with_the_time_its_reply_left_the_wire() -> None:
    rig = await Rig().online()
    rig.unit.holding[P003] = 815
    await asyncio.sleep(1.0)

    rig.poll(VALUES)

    (current,) = rig.sink.values("current")
    assert (current.value, current.unit, current.quality) == (81.5, "A", Quality.GOOD)
    assert current.time_s == rig.clock.utc_s()


@virtually
async def test_a_change_within_the_pause_goes_out_when_the_pause_is_over() -> None:
    rig = await Rig().online()
    rig.unit.holding[P003] = 100
    await asyncio.sleep(1.0)
    rig.poll(VALUES)
    await asyncio.sleep(0.1)
    rig.unit.holding[P003] = 200
    rig.poll(VALUES)
    assert [record.value for record in rig.sink.values("current")] == [10.0]

    await asyncio.sleep(0.16)

    assert [record.value for record in rig.sink.values("current")] == [10.0, 20.0]


@virtually
async def test_every_point_that_was_good_is_published_as_stale_even_right_after_a_publication() -> None:
    rig = await Rig().online()
    await asyncio.sleep(1.0)
    rig.unit.holding[P003] = 815
    rig.poll(VALUES)

    rig.lose()
    await asyncio.sleep(0.3)

    assert [record.quality for record in rig.sink.values("current")] == [Quality.GOOD, STALE]


@virtually
async def test_a_starter_that_never_answered_is_offline_for_the_reason_the_line_gives() -> None:
    rig = Rig()
    rig.telemetry.start()

    rig.lose("no reply")
    rig.lose("no reply")

    assert [record.reason for record in rig.sink.of(AvailabilityRecord)] == ["not yet read", "no reply"]
    assert rig.sink.events() == []


@virtually
async def test_rows_read_for_a_command_bring_a_lost_starter_back() -> None:
    rig = await Rig().online()
    rig.lose()

    rig.telemetry.take_rows({"VB01": (READY,)}, at_s=rig.clock.now_s())
    await asyncio.sleep(0)

    assert rig.telemetry.is_answering


@virtually
async def test_a_disabled_starter_that_is_stopped_stays_disabled() -> None:
    rig = Rig(is_enabled=False)
    rig.telemetry.start()
    rig.sink.clear()

    rig.telemetry.take_rows({"VB01": (READY,)}, at_s=rig.clock.now_s())

    assert rig.sink.records == []
    assert rig.telemetry.snapshot.rows == {"VB01": (READY,)}


@pytest.mark.parametrize("outcome", [Silent(), Garbled("bad CRC", b""), Refused(6, 0.0)])
@virtually
async def test_values_that_are_no_longer_answered_become_stale(outcome: Outcome) -> None:
    rig = await Rig().online()
    await asyncio.sleep(1.0)
    rig.poll()

    for _ in range(11):
        rig.telemetry.on_poll(VALUES, outcome)
        rig.poll(STATUS)
        await asyncio.sleep(1.0)

    assert rig.telemetry.is_answering
    assert rig.sink.values("current")[-1].quality is STALE
    assert rig.telemetry.snapshot.readings["running"].quality is Quality.GOOD
    assert "unknown" not in rig.sink.states()


@virtually
async def test_a_value_that_was_not_answered_for_a_minute_is_good_for_no_longer_after_that() -> None:
    rig = await Rig().online()
    for _ in range(60):
        await asyncio.sleep(1.0)
        rig.poll(STATUS)
    rig.poll(VALUES)

    for _ in range(20):
        await asyncio.sleep(1.0)
        rig.poll(STATUS)

    assert [record.quality for record in rig.sink.values("current")][-2:] == [Quality.GOOD, STALE]


@virtually
async def test_a_slow_line_does_not_make_its_values_stale() -> None:
    rig = await Rig().online()

    for _ in range(80):
        await asyncio.sleep(3.9)
        rig.poll()

    assert {record.quality for record in rig.sink.values("running")} == {Quality.GOOD}


@pytest.mark.parametrize("every_s", [0.0, 1.0])
@virtually
async def test_a_line_with_long_rounds_does_not_make_its_values_stale(every_s: float) -> None:
    rig = await Rig(every_s=every_s).online()
    rig.line.stretch = 15.0

    for _ in range(10):
        await asyncio.sleep(15.0)
        rig.poll()

    assert STALE not in {record.quality for record in rig.sink.values("running")}
    assert rig.telemetry.snapshot.readings["running"].quality is Quality.GOOD


@pytest.mark.parametrize("every_s", [0.0, 1.0])
@virtually
async def test_a_status_that_was_read_twice_in_a_row_on_an_overfull_line_is_good_until_its_next_time(
    every_s: float,
) -> None:
    rig = await Rig(every_s=every_s).online()
    rig.line.stretch = 15.0

    for _ in range(10):
        rig.poll()
        await asyncio.sleep(0.3)
        rig.poll(STATUS)
        await asyncio.sleep(15.0)

    assert "unknown" not in rig.sink.states()


@virtually
async def test_a_line_that_becomes_overfull_after_a_reading_makes_it_stale_no_sooner_than_its_next_time() -> (
    None
):
    rig = await Rig().online()
    await rig.poll_for(10.0)
    rig.line.stretch = 15.0

    await asyncio.sleep(15.0)
    rig.poll()

    assert "unknown" not in rig.sink.states()


@virtually
async def test_what_is_not_read_any_more_on_an_overfull_line_is_good_for_six_of_its_periods_at_most() -> None:
    rig = await Rig().online()
    rig.line.stretch = 15.0
    for _ in range(3):
        await asyncio.sleep(30.0)
        rig.poll()

    await asyncio.sleep(6 * 15.0 + 1.5)

    assert rig.sink.states()[-1] == "unknown"


@virtually
async def test_closing_leaves_no_timer_and_no_task_behind() -> None:
    rig = Rig()
    rig.telemetry.start()
    rig.poll()

    await rig.telemetry.close()
    rig.sink.clear()
    await asyncio.sleep(100.0)

    assert rig.sink.records == []
    assert len(asyncio.all_tasks()) == 1


@virtually
async def test_an_end_says_offline_then_stale_states_then_stale_values_and_nothing_good_after_that() -> None:
    rig = await Rig().online()
    rig.unit.holding[P003] = 815
    rig.poll(VALUES)  # within the pause after a publication
    good = {
        name for name, reading in rig.telemetry.snapshot.readings.items() if reading.quality is Quality.GOOD
    }
    rig.sink.clear()

    rig.telemetry.end("the gateway ended")
    rig.poll()  # what was under way
    rig.telemetry.take_rows({"P003": (1,)}, at_s=rig.clock.now_s())
    rig.telemetry.on_unit(is_answering=True, reason="answers")
    rig.telemetry.publish_stale_values()
    await rig.telemetry.close()
    await asyncio.sleep(100.0)

    kinds = [type(record) for record in rig.sink.records]
    assert kinds[:2] == [AvailabilityRecord, StateRecord]
    assert kinds.count(AvailabilityRecord) == kinds.count(StateRecord) == 1
    (availability,) = rig.sink.of(AvailabilityRecord)
    assert (availability.state, availability.reason) == ("offline", "the gateway ended")
    assert [record.quality for record in rig.sink.of(StateRecord)] == [STALE]
    values = rig.sink.of(ValueRecord)
    assert {record.point for record in values if record.quality is STALE} == good
    assert all(record.quality in (STALE, Quality.BAD) for record in values)
    assert rig.sink.values("current")[-1].value == 81.5  # the last good one, with its own time
    assert rig.sink.events() == []


@virtually
async def test_an_end_leaves_a_disabled_starter_disabled_and_one_that_never_answered_offline_as_it_was() -> (
    None
):
    disabled, silent = Rig(is_enabled=False), Rig()
    for rig in (disabled, silent):
        rig.telemetry.start()
        rig.telemetry.end("the gateway ended")

    assert [record.state for record in disabled.sink.of(AvailabilityRecord)] == ["disabled"]
    assert [record.reason for record in silent.sink.of(AvailabilityRecord)] == ["not yet read"]
