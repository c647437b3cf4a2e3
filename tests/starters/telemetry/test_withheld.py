"""Nothing of a starter is good before it is known which device answers."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.line.rtu.outcome import Refused, Silent
from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadInputRegisters
from gateway.records import AvailabilityRecord, EventRecord, Quality, StateRecord, ValueRecord
from gateway.sim.factory import make_unit
from gateway.starters.identity.first_contact import IdentityStatus
from gateway.starters.telemetry.identity_check import Withheld
from tests.starters.fakes import AT_SPEED, P003, VB01, RecordingSink
from tests.starters.one_starter import TestMemory, one_starter
from tests.starters.rig import Rig, virtually

GIVEN_UP_S = 8.0  # three rounds of questions, 2 s and 4 s apart
WRONG = [(is_, said) for is_ in FAMILIES for said in FAMILIES if is_ != said]


def good(sink: RecordingSink) -> list[ValueRecord | StateRecord]:
    published = [*sink.of(ValueRecord), *sink.of(StateRecord)]
    return [record for record in published if record.quality is Quality.GOOD]


def test_the_latest_of_each_read_is_withheld_and_given_back_in_the_order_of_time() -> None:
    withheld = Withheld()
    withheld.put({"P003": (1,)}, at_s=1.0)
    withheld.put({"VB01": (2,)}, at_s=2.0)
    withheld.put({"P003": (3,)}, at_s=3.0)

    assert withheld.release() == [(2.0, {"VB01": (2,)}), (3.0, {"P003": (3,)})]
    assert not withheld.is_open
    assert withheld.release() == []


def test_what_was_withheld_before_a_silence_is_never_given_back() -> None:
    withheld = Withheld()
    withheld.put({"P003": (1,)}, at_s=1.0)

    withheld.withhold()

    assert withheld.is_open
    assert withheld.release() == []


@pytest.mark.parametrize(("is_", "said"), WRONG)
@virtually
async def test_no_value_and_no_state_of_another_family_is_ever_good(is_: str, said: str) -> None:
    async with one_starter(make_unit(is_, 1), family=said) as here:
        await asyncio.sleep(60.0)

        assert good(here.sink) == []
        assert here.telemetry.is_answering
        assert not here.events("started", "fault", "alarm")


@virtually
async def test_nor_is_one_of_a_device_that_was_exchanged_between_two_runs() -> None:
    memory = TestMemory()
    async with one_starter(make_unit("ssw07", 1), memory=memory):
        await asyncio.sleep(10.0)
    assert memory.document is not None

    unit = make_unit("ssw06", 1, rated_current_a=950.0)
    async with one_starter(unit, family="ssw07", memory=memory) as here:
        await asyncio.sleep(30.0)

        assert good(here.sink) == []


@virtually
async def test_nor_is_one_of_a_device_that_was_exchanged_while_it_was_silent() -> None:
    async with one_starter(make_unit("ssw07", 1)) as here:
        await asyncio.sleep(10.0)
        here.sink.clear()

        await here.replace(make_unit("ssw06", 1, rated_current_a=950.0))

        assert good(here.sink) == []
        assert here.sink.of(AvailabilityRecord)[-1].state == "degraded"


@virtually
async def test_the_first_value_of_a_large_model_has_its_right_scale() -> None:
    unit: Any = make_unit("ssw06", 1, rated_current_a=950.0)
    async with one_starter(unit, family="ssw06") as here:
        unit._set_remote(is_remote=False)
        unit.keypad_start()
        await asyncio.sleep(30.0)
        currents = [float(each.value or 0) for each in here.sink.values("current") if each.value]
        raw = here.telemetry.snapshot.rows["P003"][0]
        assert currents[-1] == raw  # whole amperes from 820 A up (ssw06-es 4.4)
        assert min(currents) > raw / 5  # none of them ten times too small


@virtually
async def test_the_state_says_why_it_is_unknown() -> None:
    async with one_starter(make_unit("ssw06", 1), family="ssw07") as here:
        await asyncio.sleep(30.0)

        reasons = [each.reason for each in here.sink.of(StateRecord)]
        assert reasons[0] == ""  # it does not answer yet: availability says that
        assert reasons[1] == "it is being identified"
        assert "it is ssw06, not ssw07" in reasons[2]


@virtually
async def test_a_device_without_a_function_that_the_family_has_is_another() -> None:
    async with one_starter(make_unit("ssw07", 1), family="sst") as here:
        await asyncio.sleep(10.0)

        assert here.telemetry.identity_standing is IdentityStatus.MISMATCHED
        assert "refuses Modbus function 04" in here.telemetry.identity_reason
        assert len(here.events("identity_mismatch")) == 1


@pytest.mark.parametrize("seed", range(6))  # to an SSW-06's 10 ms an SST comes and goes
@pytest.mark.parametrize("family", ["ssw06", "ssw07", "ssw900"])
@virtually
async def test_of_an_sst_whose_replies_are_late_for_the_configured_family_nothing_is_good(
    family: str, seed: int
) -> None:
    async with one_starter(make_unit("sst", 1, seed=seed), family=family) as here:
        await asyncio.sleep(300.0)

        assert good(here.sink) == []
        assert "refuses Modbus function 03" in " ".join(each.reason for each in here.sink.of(StateRecord))


@pytest.mark.parametrize(("device", "family"), [each for each in WRONG if each != ("sst", "ssw06")])
@virtually
async def test_the_state_of_any_other_familys_device_says_so_and_nothing_of_it_is_good(
    device: str, family: str
) -> None:
    async with one_starter(make_unit(device, 1), family=family) as here:
        await asyncio.sleep(15.0)

        state = here.sink.of(StateRecord)[-1]
        assert (state.state, state.quality) == ("unknown", Quality.BAD)
        assert f"not {family}" in state.reason
        last = {record.point: record for record in here.sink.of(ValueRecord)}
        assert {record.quality for record in last.values()} == {Quality.BAD}
        assert all(f"not {family}" in record.reason for record in last.values())
        assert len(here.events("identity_mismatch")) == 1


@virtually
async def test_one_refusal_by_chance_proves_no_other_device() -> None:
    rig, left = Rig("sst"), [1]

    def refuse_once(request: Request) -> Refused | None:
        is_first = isinstance(request, ReadInputRegisters) and (request.address, request.count) == (0, 12)
        return Refused(1, at_s=0.0) if is_first and left and left.pop() else None

    rig.line.rules.append(refuse_once)
    rig.telemetry.start()
    await rig.poll_for(5.0)

    assert rig.telemetry.identity_standing is IdentityStatus.MATCHING
    assert "identity_mismatch" not in rig.sink.events()


@virtually
async def test_what_was_read_meanwhile_is_published_with_its_own_time_once_it_is_identified() -> None:
    rig = Rig()
    rig.unit.holding[P003] = 815
    rig.telemetry.start()
    rig.poll()
    read_s = rig.clock.utc_s()
    assert good(rig.sink) == []

    await asyncio.sleep(0.3)  # no poll comes in between

    assert rig.sink.states()[-1] == "ready"
    current = rig.sink.values("current")[-1]
    assert (current.value, current.quality, current.time_s) == (81.5, Quality.GOOD, read_s)


@virtually
async def test_a_device_that_refuses_to_say_who_it_is_is_read_after_it_was_asked_twice() -> None:
    rig = Rig()
    rig.line.rules.append(lambda r: Refused(1, at_s=0.0) if isinstance(r, ReadDeviceIdentification) else None)
    rig.telemetry.start()
    await rig.poll_for(2.0)
    assert good(rig.sink) == []  # one refusal proves nothing

    await rig.poll_for(1.0)

    assert rig.telemetry.identity_standing is IdentityStatus.UNKNOWN
    assert rig.sink.values("running")[-1].quality is Quality.GOOD


@virtually
async def test_a_device_that_never_says_who_it_is_is_read_after_a_few_seconds() -> None:
    rig = Rig()
    rig.line.rules.append(unanswered)
    rig.telemetry.start()
    await rig.poll_for(5.0)
    assert good(rig.sink) == []
    assert rig.sink.of(StateRecord)[-1].reason == "it is being identified"

    await rig.poll_for(GIVEN_UP_S - 5.0)

    assert rig.sink.states()[-1] == "ready"
    assert rig.telemetry.identity_standing is IdentityStatus.UNKNOWN  # commands are still held


@virtually
async def test_after_a_silence_values_stay_stale_until_it_is_identified_again() -> None:
    rig = await Rig().online()
    rig.lose()
    rig.line.rules.append(unanswered)
    rig.sink.clear()

    await rig.poll_for(3.0)
    assert good(rig.sink) == []
    assert rig.telemetry.snapshot.readings["running"].quality is Quality.STALE
    rig.line.rules.clear()
    await rig.poll_for(5.0)

    assert rig.sink.values("running")[-1].quality is Quality.GOOD


@virtually
async def test_a_change_during_the_identification_is_an_event_after_it() -> None:
    rig = await Rig().online()
    rig.lose()
    rig.unit.holding[VB01] = AT_SPEED
    await rig.poll_for(2.0)

    assert [e.code for e in rig.sink.of(EventRecord)][-1] == "started"


@virtually
async def test_flags_that_never_stood_together_are_no_event() -> None:
    """A start that is first tested and then ramped: each flag settles by itself, the state as a whole."""
    rig = await Rig("ssw900").online()
    status, waits, runs = 680, 0x0102 | 1 << 3, 0x0102 | 1 << 0 | 1 << 4
    row = rig.setup.profile.parameters["S5.1.1"].address
    assert row == status
    for word in (waits, waits, 0x0102 | 1 << 12, runs, runs, runs):
        rig.unit.holding[status] = word
        await asyncio.sleep(0.1)
        rig.poll("pump-1/status:S5.1.1")

    assert [code for code in rig.sink.events() if code in ("started", "stopped")] == ["started"]


def unanswered(request: Request) -> Silent | None:
    return Silent() if isinstance(request, ReadDeviceIdentification) else None
