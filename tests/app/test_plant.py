"""Lines and starters that come, go and change, and what is reported of them; in virtual time."""

from __future__ import annotations

import asyncio

from gateway.line.events import LineFault, PollResult, UnitChanged
from gateway.line.rtu.outcome import Answered, Silent
from gateway.records import AlarmRecord, AvailabilityRecord, EventRecord, InfoRecord
from tests.plant_rig import HALL, running, starter
from tests.starters.rig import virtually

SLOT_S = 0.25  # more than any one slot of another starter on its line
BROKER = 'url = "mqtt://127.0.0.1"'
FAN = starter("fan", 2, "ssw06")


@virtually
async def test_a_reload_that_changes_nothing_touches_nothing() -> None:
    async with running() as here:
        records, reported = len(here.sink.records), list(here.events)
        starters, lines = dict(here.plant.starters), dict(here.plant.lines)

        await here.reload()

        assert here.plant.starters == starters
        assert here.plant.lines == lines
        assert len(here.sink.records) == records
        assert here.events == reported


@virtually
async def test_another_period_takes_effect_and_the_starter_stays_online() -> None:
    async with running() as here:
        before = here.plant.starters["fan"]
        records = len(here.sink.records)

        await here.reload((FAN, FAN.replace("every_s = 1.0", "every_s = 0.2")))
        await asyncio.sleep(10.0)

        assert here.plant.starters["fan"] is before
        assert here.said("fan") == ["offline", "online"]
        assert not [r for r in here.sink.records[records:] if isinstance(r, AvailabilityRecord)]
        assert sum(at_s > 30.0 for at_s in here.requests_s["hall 2"]) > 45


@virtually
async def test_unchanged_values_are_published_again_after_the_configured_time_also_a_reloaded_one() -> None:
    async with running() as here:
        first = len(here.of_point("fan", "remote"))
        await asyncio.sleep(300.0)
        second = len(here.of_point("fan", "remote"))

        await here.reload((BROKER, f"{BROKER}\nrefresh_s = 20.0"))
        await asyncio.sleep(60.0)

        assert second - first == 1
        assert len(here.of_point("fan", "remote")) - second >= 3


@virtually
async def test_a_lock_that_ends_after_its_starter_went_publishes_nothing_of_it() -> None:
    async with running() as here:
        fan = here.plant.starters["fan"]
        await here.reload((FAN, ""))
        records = len(here.sink.records)

        fan.republish_state()
        await asyncio.sleep(400.0)

        assert not [r for r in here.sink.records[records:] if getattr(r, "starter", "") == "fan"]


@virtually
async def test_a_starter_that_goes_is_asked_no_more_and_forgotten() -> None:
    async with running() as here:
        await here.reload((FAN, ""))
        records, asked = len(here.sink.records), len(here.requests_s["hall 2"])
        await asyncio.sleep(60.0)

        assert here.forgotten == ["fan"]
        assert len(here.requests_s["hall 2"]) <= asked + 1  # one may have been on the wire
        assert not [r for r in here.sink.records[records:] if getattr(r, "starter", "") == "fan"]
        assert "fan" not in here.plant.starters
        statistics = here.plant.lines["hall"].statistics()
        assert 1 in statistics["units"]


@virtually
async def test_a_starter_that_comes_is_asked_at_once_identified_and_reported() -> None:
    async with running() as here:
        here.connect("hall", 3, "ssw07")
        await here.reload((FAN, FAN + starter("new", 3, "ssw07")))
        came_s = asyncio.get_running_loop().time()
        await asyncio.sleep(10.0)

        assert here.requests_s["hall 3"][0] - came_s < SLOT_S
        assert here.said("new") == ["offline", "online"]
        assert here.states("new")[-1] == "ready"
        infos = [record for record in here.sink.of(InfoRecord) if record.starter == "new"]
        assert infos[-1].model is not None
        readiness = [e for e in here.sink.of(EventRecord) if (e.starter, e.code) == ("new", "readiness")]
        assert len(readiness) == 1
        assert here.writes() == 0


@virtually
async def test_an_answer_to_a_question_of_before_is_not_taken_for_the_new_starters() -> None:
    async with running() as here:
        old = here.plant.starters["fan"]
        keys = [poll.key for poll in old.polls()]

        await here.reload((FAN, FAN.replace("every_s = 1.0", "every_s = 1.0\nresponse_time_s = 0.5")))
        new = here.plant.starters["fan"]
        for key in keys:
            here.plant.handle(
                PollResult("hall", key, 2, Answered((0xFFFF,) * 20, at_s=30.0, response_time_s=0.01))
            )

        assert new is not old
        assert here.said("fan")[-1] == "offline"
        assert new.snapshot.good_values() == {}
        assert {poll.key for poll in new.polls()}.isdisjoint(keys)


@virtually
async def test_a_starter_that_was_silent_is_asked_at_once_when_another_takes_its_place() -> None:
    async with running() as here:
        here.buses["/dev/hall"].remove(here.unit("hall", 2))
        await asyncio.sleep(120.0)
        assert here.said("fan")[-1] == "offline"

        here.connect("hall", 2, "ssw07")
        await here.reload((FAN, starter("blower", 2, "ssw07")))
        await asyncio.sleep(1.0)

        assert here.said("blower")[-1] == "online"


@virtually
async def test_what_a_starter_reports_on_a_new_line_is_its_own() -> None:
    async with running() as here:
        await here.reload((HALL, HALL.replace("19200", "19200\nadapter_allowance_s = 0.03")))
        await asyncio.sleep(5.0)

        assert here.events.count("port_open hall") == 2
        assert here.events.count("port_open yard") == 1
        assert here.said("pump") == ["offline", "online", "offline", "online"]
        assert here.said("mill") == ["offline", "online"]
        assert here.buses["/dev/hall"].opened == 2
        assert here.buses["/dev/yard"].opened == 1


@virtually
async def test_a_lost_port_makes_only_its_own_starters_offline() -> None:
    async with running() as here:
        here.buses["/dev/hall"].unplug()
        await asyncio.sleep(3.0)

        assert (here.said("pump")[-1], here.said("mill")[-1]) == ("offline", "online")
        assert here.events[-1] == "port_away hall"


@virtually
async def test_news_of_no_one_is_for_no_one() -> None:
    async with running() as here:
        records = len(here.sink.records)

        here.plant.handle(PollResult("hall", "x", 99, Silent()))
        here.plant.handle(UnitChanged("hall", 99, is_answering=True, reason="answers"))
        here.plant.handle(LineFault("hall", "babbling", 0, "somebody talks"))

        assert len(here.sink.records) == records
        assert here.events[-1] == "babbling hall"


@virtually
async def test_names_are_published_in_the_language_of_the_site_and_in_english_where_it_is_lacking() -> None:
    async with running(30.0, ('name = "plant"', 'name = "plant"\nlanguage = "es"')) as here:
        here.unit("hall", 1).trip(28)
        await asyncio.sleep(30.0)

        info = {record.starter: record.points for record in here.sink.of(InfoRecord)}
        assert info["fan"]["current"]["name"] == "corriente del motor en amperes"
        assert info["fan"]["fault"]["meaning"] == "false: sin error; true: con error"
        assert info["pump"]["current"]["name"] == "motor current"
        texts = {record.starter: record.text for record in here.sink.of(AlarmRecord)}
        assert texts["pump"] == "Serial communication inactive"
