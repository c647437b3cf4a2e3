"""Nothing of a starter is good before it is known which device answers."""

from __future__ import annotations

import asyncio

from gateway.families.profile.load import FAMILIES
from gateway.line.rtu.outcome import Refused, Silent
from gateway.modbus.device_id import ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadInputRegisters
from gateway.records import EventRecord, Quality, StateRecord, ValueRecord
from gateway.starters.identity.first_contact import IdentityStatus
from gateway.starters.telemetry.identity_check import Withheld
from tests.starters.fakes import AT_SPEED, P003, VB01, RecordingSink
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
