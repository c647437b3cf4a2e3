from __future__ import annotations

from gateway.line.outcome import Answered
from gateway.starters.dispatch import LineDispatch
from gateway.starters.records import AvailabilityRecord, EventRecord, Severity
from tests.starters.fakes import Rig, virtually

STATUS = "pump-1/status:VB01"
READY_REPLY = Answered((0x4102,), at_s=0.0, response_time_s=0.005)


def dispatch_of(rig: Rig) -> LineDispatch:
    dispatch = LineDispatch(sink=rig.sink, clock=rig.clock, sequence=rig.sequence)
    dispatch.add(rig.telemetry)
    rig.telemetry.start()
    rig.sink.clear()
    return dispatch


@virtually
async def test_a_poll_goes_to_the_starter_of_its_line_and_unit() -> None:
    rig = Rig()
    dispatch = dispatch_of(rig)

    dispatch.on_poll("pumps", STATUS, 7, READY_REPLY)

    assert rig.sink.states() == ["ready"]


@virtually
async def test_what_concerns_nobody_here_is_ignored() -> None:
    rig = Rig()
    dispatch = dispatch_of(rig)

    dispatch.on_poll("fans", STATUS, 7, READY_REPLY)
    dispatch.on_poll("pumps", STATUS, 8, READY_REPLY)
    dispatch.on_unit("pumps", 8, True, "", ())

    assert rig.sink.records == []


@virtually
async def test_a_unit_that_goes_silent_takes_its_starter_offline() -> None:
    rig = Rig()
    dispatch = dispatch_of(rig)
    dispatch.on_unit("pumps", 7, True, "", ())

    dispatch.on_unit("pumps", 7, False, "no reply", (">> 07",))

    assert [record.state for record in rig.sink.of(AvailabilityRecord)] == ["online", "offline"]


@virtually
async def test_a_lost_port_takes_every_starter_of_its_line_offline() -> None:
    rig = Rig()
    dispatch = dispatch_of(rig)
    dispatch.on_unit("pumps", 7, True, "", ())
    rig.sink.clear()

    dispatch.on_port("fans", False, "unplugged")
    assert rig.sink.of(AvailabilityRecord) == []
    dispatch.on_port("pumps", False, "unplugged")

    (offline,) = rig.sink.of(AvailabilityRecord)
    assert (offline.state, offline.reason) == ("offline", "unplugged")
    lost = rig.sink.of(EventRecord)[-2]
    assert (lost.starter, lost.code, lost.severity) == ("", "port_away", Severity.ERROR)


@virtually
async def test_an_opened_port_is_an_event_of_the_gateway() -> None:
    rig = Rig()
    dispatch = dispatch_of(rig)

    dispatch.on_port("pumps", True, "")

    (event,) = rig.sink.of(EventRecord)
    assert (event.starter, event.code, event.data["line"]) == ("", "port_open", "pumps")


@virtually
async def test_a_removed_starter_hears_nothing_more() -> None:
    rig = Rig()
    dispatch = dispatch_of(rig)

    dispatch.remove(rig.telemetry)
    dispatch.remove(rig.telemetry)
    dispatch.on_poll("pumps", STATUS, 7, READY_REPLY)

    assert rig.sink.records == []
