"""A stop speaks the words of the family that the device proved to be, and says so."""

from __future__ import annotations

import asyncio

from gateway.families.devices.device import Identity
from gateway.families.diagnosis.identify import stop_note, stop_profile
from gateway.families.profile.load import load_profile
from gateway.sim.factory import make_unit
from gateway.starters.commands.stop_family import StopAddressee
from gateway.starters.identity.first_contact import IdentityStatus
from tests.starters.one_starter import one_starter
from tests.starters.rig import virtually


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


def test_while_nothing_is_proved_the_configured_words_are_used_without_a_note() -> None:
    profile, unknown = load_profile("ssw06"), Identity(reason="not yet asked")

    assert stop_profile(profile, unknown) is profile
    assert stop_note(profile, unknown, ["ssw06"]) == ""
