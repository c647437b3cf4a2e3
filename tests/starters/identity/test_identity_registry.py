"""Another starter than before, or than configured: commands are held until somebody accepts it."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest

from gateway.modbus.adu import decode
from gateway.modbus.reads import ReadInputRegisters
from gateway.records import (
    AvailabilityRecord,
    Phase,
    Quality,
)
from gateway.sim.bus.faults import Reply
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.starters.identity.first_contact import IdentityStatus
from tests.starters.identity.habits import at_first, device
from tests.starters.one_starter import OneStarter, TestMemory, one_starter
from tests.starters.rig import virtually

OURS: dict[str, dict[str, Any]] = {
    "ssw06": {"rated_current_a": 85.0, "firmware": "1.60"},
    "ssw07": {"rated_current_a": 85.0, "firmware": "1.60"},
    "ssw900": {"serial_number": 1, "firmware": "1.20"},
    "sst": {"serial_number": 1},
}
OTHERS: list[tuple[str, dict[str, Any], str]] = [
    ("ssw06", {"rated_current_a": 130.0}, "rated_current"),
    ("ssw07", {"firmware": "1.70"}, "firmware"),
    ("ssw07", {"rated_current_a": 130.0}, "model"),
    ("ssw900", {"serial_number": 2}, "serial"),
    ("ssw900", {"rated_current_a": 950.0}, "rated_current"),
    ("ssw900", {"firmware": "1.30"}, "firmware"),
    ("sst", {"serial_number": 2}, "serial"),
]


def is_name(pdu: bytes) -> bool:
    return pdu == ReadInputRegisters(22, 8).encode()


def ours(family: str, **changes: Any) -> SimulatedUnit:
    return make_unit(family, 1, **{**OURS[family], **changes})


async def ask(
    here: OneStarter, verb: str, id_: str, within_s: float = 30.0, **args: Any
) -> tuple[Phase, str]:
    here.submit(verb, id_, **args)
    await asyncio.sleep(within_s)
    final = here.sink.final(id_)
    return final.phase, final.code


@pytest.mark.parametrize("code", [2, 4, 6, None])  # None: such long frames are lost
@virtually
async def test_an_sst_whose_name_can_be_read_only_later_is_the_same_and_stays_it(code: int | None) -> None:
    memory = TestMemory()
    for code_of_name in (code, 0, code):  # 0: the name is answered
        times = 0 if code_of_name == 0 else 10_000
        unit = device("sst", 0, at_first(times, is_name, code=code_of_name))
        async with one_starter(unit, memory=memory) as here:
            await asyncio.sleep(60.0)

            assert here.events("identity_changed") == []
            assert await ask(here, "start", "1") != (Phase.REJECTED, "identity_changed")

    assert memory.document is not None
    assert memory.document["starters"]["pump"]["model"] == "SST330i-M"


@virtually
async def test_what_another_starter_is_accused_of_begins_with_serial_number_and_firmware() -> None:
    memory = TestMemory({"starters": {"pump": {"serial": "7", "firmware": "1.0", "model": "SST360i-M"}}})
    async with one_starter(ours("sst"), memory=memory) as here:
        await asyncio.sleep(10.0)

        (event,) = here.events("identity_changed")
        assert event.text.startswith("another starter than before? serial was 7, is 1; firmware was 1.0, is")


@pytest.mark.parametrize("is_other", [False, True])
@virtually
async def test_there_is_nothing_to_accept_while_nothing_is_held_or_no_device_answers(
    *, is_other: bool
) -> None:
    async with one_starter(ours("ssw07")) as here:
        await asyncio.sleep(10.0)
        if is_other:
            await here.replace(ours("ssw07", firmware="1.70"))
            here.unit.power_off()
            await asyncio.sleep(30.0)

        assert await ask(here, "accept", "1") == (Phase.REJECTED, "nothing_to_accept")


@virtually
async def test_another_model_than_configured_is_held_until_it_is_accepted_for_that_configuration() -> None:
    memory = TestMemory()
    async with one_starter(ours("ssw07"), model="SSW-07 130A", memory=memory) as here:
        await asyncio.sleep(10.0)
        (event,) = here.events("identity_changed")
        assert "the configuration says SSW-07 130A" in event.text
        assert await ask(here, "start", "1") == (Phase.REJECTED, "identity_changed")
        assert await ask(here, "accept", "2") == (Phase.CONFIRMED, "ok")

    async with one_starter(ours("ssw07"), model="SSW-07 130A", memory=memory) as here:
        await asyncio.sleep(10.0)
        assert here.events("identity_changed") == []

    async with one_starter(ours("ssw07"), model="SSW-07 200A", memory=memory) as here:
        await asyncio.sleep(10.0)
        assert len(here.events("identity_changed")) == 1


@virtually
async def test_an_acceptance_that_cannot_be_stored_counts_for_this_run_and_says_so() -> None:
    memory = TestMemory()
    async with one_starter(ours("ssw07"), memory=memory) as here:
        await asyncio.sleep(10.0)
        await here.replace(ours("ssw07", firmware="1.70"))
        memory.is_full = True

        assert await ask(here, "accept", "1") == (Phase.FAILED, "not_kept")
        assert here.telemetry.identity_standing is IdentityStatus.MATCHING
        assert here.events("identities_away")

        memory.is_full = False
        await asyncio.sleep(30.0)
        assert here.events("identities_back")


@pytest.mark.parametrize("stored", [{"starters": 7}, None])
@virtually
async def test_after_a_damage_every_starter_counts_as_new_and_that_is_an_event(
    stored: dict[str, Any] | None,
) -> None:
    memory = TestMemory(stored)
    memory.is_damaged = stored is None
    async with one_starter(ours("ssw07"), memory=memory) as here:
        await asyncio.sleep(10.0)

        assert "every starter counts as new" in here.events("memory_damaged")[0].text
        assert here.telemetry.identity_standing is IdentityStatus.MATCHING
        assert len(memory.aside) == 1


@virtually
async def test_what_is_no_fingerprint_in_the_file_is_passed_over() -> None:
    memory = TestMemory({"starters": {"pump": {"model": 7}}})
    async with one_starter(ours("ssw07"), memory=memory) as here:
        await asyncio.sleep(10.0)

        assert here.telemetry.identity_standing is IdentityStatus.MATCHING


class WithoutVersion:
    """An impairment: replies with S3.2.1 (121) are lost in any form, so that only FC43 says a version."""

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        pdu = decode(reply.adu).pdu
        words = [pdu[at : at + 2] for at in range(2, len(pdu), 2)]
        return () if pdu[0] == 3 and (121).to_bytes(2, "big") in words else (reply,)


@virtually
async def test_an_open_question_holds_commands_but_is_no_change_yet() -> None:
    memory = TestMemory()
    async with one_starter(ours("ssw900"), memory=memory):
        await asyncio.sleep(10.0)
    assert memory.document is not None
    memory.document["starters"]["pump"]["firmware"] = "1.21"  # as S3.2.1 said, unlike FC43

    unit: Any = ours("ssw900")
    unit.fixed[328] = 121
    async with one_starter(unit, memory=memory) as here:
        here.bus.impair(1, WithoutVersion())
        await asyncio.sleep(2.5)
        assert await ask(here, "start", "0", 0.1) == (Phase.REJECTED, "identity_changed")
        assert await ask(here, "accept", "1", 0.1) == (Phase.REJECTED, "nothing_to_accept")

        here.bus.heal(1)
        await asyncio.sleep(30.0)

        assert here.telemetry.identity_standing is IdentityStatus.MATCHING
        assert here.events("identity_changed") == []


@virtually
async def test_values_of_another_model_than_configured_are_bad_until_it_is_accepted() -> None:
    async with one_starter(ours("ssw07"), model="SSW-07 130A") as here:
        await asyncio.sleep(30.0)
        held = here.telemetry.snapshot.readings["current"]
        assert (held.value, held.quality) == (None, Quality.BAD)
        assert "the configuration says SSW-07 130A" in held.reason

        assert await ask(here, "accept", "1") == (Phase.CONFIRMED, "ok")

        assert {each.quality for each in here.telemetry.snapshot.readings.values()} >= {Quality.GOOD}
        assert here.telemetry.snapshot.readings["current"].quality is Quality.GOOD
        assert here.telemetry.snapshot.readings["current"].reason == ""
        assert here.sink.of(AvailabilityRecord)[-1].state == "online"
