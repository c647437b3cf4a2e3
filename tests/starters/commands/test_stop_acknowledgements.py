"""A stop whose acknowledgement is lost or late is confirmed by the next, or by its readings at the end."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass, replace

import pytest

from gateway.families.diagnosis.identify import identify_requests
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.line.rtu.outcome import Garbled, Outcome, Silent
from gateway.modbus.adu import decode
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil
from gateway.records import Phase, Quality, ValueRecord
from gateway.sim.bus.faults import Reply
from gateway.sim.factory import make_unit
from gateway.starters.commands.stop import DEADLINE_S, SEEN_WITHIN_S
from gateway.starters.identity.first_contact import IdentityStatus
from tests.starters.fakes import READY, VB01
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually
from tests.starters.rules import ACCEPTED, CONFIRMED, WRITTEN, running

WRITES = (5, 6, 15, 16, 22)
SOON_S = 2.0  # a reply that is lost, a pause, two readings


@dataclass
class PoorAcknowledgements:
    """An impairment: the first of a starter's replies to writes are lost, or late."""

    count: int
    late_s: float | None = None  # None: lost

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        """Return what arrives."""
        if decode(reply.adu).pdu[0] not in WRITES or not self.count:
            return (reply,)
        self.count -= 1
        return () if self.late_s is None else (replace(reply, after_s=reply.after_s + self.late_s),)


async def at_speed(here: OneStarter) -> None:
    """Let the starter be identified, and its motor come to speed."""
    await asyncio.sleep(5.0)
    here.unit.advance(asyncio.get_running_loop().time())
    here.unit.motor.start()
    await asyncio.sleep(60.0)


async def stopped(here: OneStarter, *, within_s: float, name: str = "s") -> tuple[Phase, str, float]:
    """Stop a motor that runs; return the end of the stop, and how long it took."""
    loop = asyncio.get_running_loop()
    begun_s = loop.time()
    here.submit("stop", name)
    while loop.time() - begun_s < within_s:
        await asyncio.sleep(0.01)
        for phase, code in here.sink.phases(name):
            if Phase(phase).is_final:
                return Phase(phase), code, loop.time() - begun_s
    raise AssertionError(here.sink.phases(name))


@pytest.mark.parametrize("late_s", [None, 0.3, 0.9])
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_stop_whose_first_acknowledgement_is_lost_or_late_is_confirmed_soon(
    family: str, late_s: float | None
) -> None:
    async with one_starter(make_unit(family, 1)) as here:
        await at_speed(here)
        here.bus.impair(1, PoorAcknowledgements(1, late_s))

        phase, _, took_s = await stopped(here, within_s=15.0)

        assert phase is Phase.CONFIRMED
        assert took_s < SOON_S


@pytest.mark.parametrize("later_s", [2.0])
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_the_stop_after_one_whose_acknowledgement_was_lost_is_confirmed_soon(
    family: str, later_s: float
) -> None:
    async with one_starter(make_unit(family, 1)) as here:
        await at_speed(here)
        here.bus.impair(1, PoorAcknowledgements(1))
        await stopped(here, within_s=15.0)

        for number in range(3):
            await asyncio.sleep(later_s)
            phase, _, took_s = await stopped(here, within_s=15.0, name=f"later {number}")

            assert phase is Phase.CONFIRMED
            assert took_s < SOON_S


@pytest.mark.parametrize("offset_s", [0.0, 0.2, 0.4])
@virtually
async def test_a_stop_that_is_never_acknowledged_is_confirmed_by_what_was_read_whenever_its_time_ends(
    offset_s: float,
) -> None:
    async with one_starter(make_unit("ssw06", 1)) as here:
        await at_speed(here)
        await asyncio.sleep(offset_s)
        here.bus.impair(1, PoorAcknowledgements(1000))

        phase, code, took_s = await stopped(here, within_s=15.0)

        assert (phase, code) == (Phase.CONFIRMED, "ok")
        assert DEADLINE_S <= took_s < DEADLINE_S + 1.0


@pytest.mark.parametrize("lost", [1, 6])
@virtually
async def test_a_reading_that_is_lost_as_the_time_ends_does_not_hide_a_motor_that_was_seen_to_stand(
    lost: int,
) -> None:
    rig = await running()
    rig.unit.holding[VB01] = READY
    until_s = rig.clock.now_s() + DEADLINE_S

    def rule(request: Request) -> Outcome | None:
        is_lost = request.is_write or rig.clock.now_s() > until_s - 0.12 * lost
        return Silent() if is_lost else None

    rig.line.rules.append(rule)
    rig.submit("stop", None)
    await asyncio.sleep(15.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]


@virtually
async def test_a_starter_that_is_silent_for_long_before_the_end_was_not_seen_to_stop() -> None:
    rig = await running()
    rig.unit.holding[VB01] = READY
    until_s = rig.clock.now_s() + DEADLINE_S - SEEN_WITHIN_S - 0.5
    rig.line.rules.append(lambda r: Silent() if r.is_write or rig.clock.now_s() > until_s else None)

    rig.submit("stop", None)
    await asyncio.sleep(15.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "not_seen")]


@pytest.mark.parametrize("is_ours", [True, False])
@virtually
async def test_an_acknowledgement_that_may_be_that_of_an_earlier_stop_does_not_count(is_ours: bool) -> None:
    rig = await running()
    rig.unit.holding[VB01] = READY
    since_s = rig.clock.now_s() + (0.0 if is_ours else -3.0)
    doubted = Garbled("may be older", b"", acknowledges_since_s=since_s)
    rig.line.rules.append(lambda r: doubted if isinstance(r, WriteCoil) else None)

    rig.submit("stop", None)
    await asyncio.sleep(SOON_S)

    assert (rig.sink.phases()[-1] == CONFIRMED) is is_ours
    await asyncio.sleep(DEADLINE_S)
    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_a_stop_is_confirmed_while_values_are_withheld_until_it_is_known_who_answers() -> None:
    unit = make_unit("ssw900", 1)
    unit.advance(0.0)
    unit.motor.start()
    handle, questions = unit.handle, [q.request.encode() for q in identify_requests(load_profile("ssw900"))]
    unit.handle = lambda pdu, now_s: None if pdu in questions else handle(pdu, now_s)  # type: ignore[method-assign]
    async with one_starter(unit) as here:
        phase, _, took_s = await stopped(here, within_s=15.0)

        assert (phase, took_s < SOON_S) == (Phase.CONFIRMED, True)
        assert here.telemetry.identity_standing is IdentityStatus.UNKNOWN
        assert not [value for value in here.sink.of(ValueRecord) if value.quality is Quality.GOOD]


@virtually
async def test_a_stop_that_does_not_arrive_is_not_confirmed_while_the_motor_is_about_to_start() -> None:
    """The time before a start (C5.7.1) shows `running` as false until the motor turns."""
    async with one_starter(make_unit("ssw900", 1, settings={931: 600})) as here:
        await asyncio.sleep(5.0)
        here.submit("start", "s1")
        await asyncio.sleep(2.0)
        answer = here.unit.handle
        here.unit.handle = lambda pdu, now_s: None if pdu[0] in WRITES else answer(pdu, now_s)

        phase, code, _ = await stopped(here, within_s=15.0)

        assert (phase, code) == (Phase.UNCONFIRMED, "not_seen")
