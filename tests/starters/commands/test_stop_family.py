"""A stop speaks the words of the family that the device proved to be, and says so."""

from __future__ import annotations

import asyncio

import pytest

from gateway.families.devices.device import Identity
from gateway.families.diagnosis.identify import stop_note, stop_profile
from gateway.families.profile.load import load_profile
from gateway.line.scheduler.requests import Priority
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.records import Phase
from gateway.sim.factory import make_unit
from gateway.sim.weg.ssw07 import Ssw07
from gateway.starters.commands.stop_family import StopAddressee
from gateway.starters.identity.first_contact import IdentityStatus
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually

START = {
    "ssw06": (WriteRegister(5003, 0x0303),),
    "ssw07": (WriteCoil(101, is_on=True), WriteCoil(100, is_on=True)),
    "ssw900": (WriteRegister(685, 0x0013),),
}
PAIRS = [(mine, other) for mine in START for other in START if mine != other]


async def run_at_full_speed(here: OneStarter, family: str) -> None:
    """Start the motor as the device itself understands it, and have everything asked of it."""
    await asyncio.sleep(30.0)
    line = here.telemetry.line
    for request in START[family]:
        await line.transact(1, request, response_time_s=0.1, lane=Priority.COMMAND)
    await asyncio.sleep(30.0)
    assert here.unit.motor.is_turned_on


@pytest.mark.parametrize(("configured", "proved"), PAIRS)
@virtually
async def test_the_words_are_those_of_the_proven_family_and_the_result_says_so(
    configured: str, proved: str
) -> None:
    async with one_starter(make_unit(proved, 1), family=configured) as here:
        await run_at_full_speed(here, proved)
        assert here.telemetry.identity_standing is IdentityStatus.MISMATCHED
        here.submit("stop", "1")
        await asyncio.sleep(9.0)

        final = here.sink.final("1")
        assert (final.phase, final.code) == (Phase.CONFIRMED, "ok")
        assert f"proved to be {proved}, not {configured}" in final.text
        assert not here.unit.motor.is_turned_on
        assert here.unit.is_enabled  # it ramps down: not generally disabled
        assert here.unit.is_remote


@virtually
async def test_a_stop_that_was_sent_before_the_device_proved_another_family_says_so() -> None:
    async with one_starter(make_unit("ssw07", 1), family="ssw06") as here:
        here.submit("stop", "1")
        await asyncio.sleep(9.0)

        final = here.sink.final("1")
        assert here.telemetry.identity_standing is IdentityStatus.MISMATCHED
        assert "before that the stop was sent as ssw06 takes it" in final.text
        assert "the stop was sent as ssw07 takes it" not in final.text


@virtually
async def test_what_is_read_in_other_words_is_not_taken_for_the_configured_familys() -> None:
    async with one_starter(make_unit("ssw07", 1), family="ssw900") as here:
        await asyncio.sleep(30.0)
        addressed, now_s = StopAddressee(here.telemetry), asyncio.get_running_loop().time()

        addressed.take_rows({"VB01": (0x4102,)}, at_s=now_s)

        assert addressed.snapshot.rows == {"VB01": (0x4102,)}
        assert "VB01" not in here.telemetry.snapshot.rows


@virtually
async def test_of_a_family_that_is_not_known_the_configured_words_are_used_and_the_result_says_so() -> None:
    async with one_starter(Ssw07(1, product="CFW-11"), family="ssw07") as here:
        await run_at_full_speed(here, "ssw07")
        here.submit("stop", "1")
        await asyncio.sleep(9.0)

        final = here.sink.final("1")
        assert final.phase is Phase.CONFIRMED
        assert "of no known family (FC43 names 'CFW-11 85.0A')" in final.text
        assert "as ssw07 takes it, as configured" in final.text
        assert not here.unit.motor.is_turned_on


@virtually
async def test_a_proven_starter_is_stopped_without_a_word_about_it() -> None:
    async with one_starter(make_unit("ssw07", 1)) as here:
        await run_at_full_speed(here, "ssw07")
        here.submit("stop", "1")
        await asyncio.sleep(9.0)

        assert here.sink.final("1").text == "read back from the starter"


@virtually
async def test_a_stop_to_a_starter_that_does_not_answer_says_so() -> None:
    async with one_starter(make_unit("ssw07", 1)) as here:
        await run_at_full_speed(here, "ssw07")
        here.bus.remove(here.unit)
        here.submit("stop", "1")
        await asyncio.sleep(30.0)

        final = here.sink.final("1")
        assert (final.phase, final.code) == (Phase.UNCONFIRMED, "no_answer")
        assert "did not answer" in final.text
        assert "may be turning" in final.text


def test_while_nothing_is_proved_the_configured_words_are_used_without_a_note() -> None:
    profile, unknown = load_profile("ssw06"), Identity(reason="not yet asked")

    assert stop_profile(profile, unknown) is profile
    assert stop_note(profile, unknown, ["ssw06"]) == ""
