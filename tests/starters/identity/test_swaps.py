"""Another device answers at a starter's address, without a silence: it is named, nothing is written to it."""

from __future__ import annotations

import asyncio

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.records import Phase, Quality, StateRecord
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.starters.identity.first_contact import LOOK_AGAIN_S, IdentityStatus
from tests.starters.identity import habits
from tests.starters.identity.habits import (
    LATE,
    PAIRS,
    Answer,
    Habit,
    as_printed,
    deaf_after_fc43,
    device,
    good_values,
    is_fc43,
    refuses_fc43,
    silent_to_fc43,
)
from tests.starters.one_starter import TIMING, OneStarter, one_starter
from tests.starters.rig import virtually

WRITES = frozenset((5, 6, 15, 16, 22, 23))
SOON_S = 15.0
AT_ONCE_S = 0.15  # the writes of one command that no reading lies between
# It refuses the watchdog's registers, which are asked for first; no value is good meanwhile.
SLOW = ("ssw900", "ssw07", 1.5)
REFUSED_S = 40.0  # of a starter that was offline: refusals that may be late are believed after 30 s
WEG_PAIRS = [each for each in PAIRS if each[1] in ("ssw06", "ssw07")]
VB00 = bytes.fromhex("03 13 88 00 01")


def swap(here: OneStarter, unit: SimulatedUnit) -> None:
    here.bus.remove(here.unit)
    here.bus.add(unit)


def swap_after(here: OneStarter, writes_before: int, unit: SimulatedUnit) -> None:
    """Have this one answer as soon as so many writes were taken."""
    right = here.unit
    answer: Answer = right.handle
    count = 0

    def handle(pdu: bytes, now_s: float) -> bytes | None:
        nonlocal count
        count += pdu[0] in WRITES
        if pdu[0] in WRITES and count == writes_before:
            asyncio.get_running_loop().call_soon(swap, here, unit)
        return answer(pdu, now_s)

    right.handle = handle


def writes(here: OneStarter) -> list[str]:
    return [pdu.hex() for pdu in here.requests() if pdu[0] in WRITES]


@pytest.mark.parametrize(
    ("gap_s", "within_s"), [(0.0, SOON_S), (1.5, SOON_S), (2.5, REFUSED_S), (9.0, REFUSED_S)]
)
@pytest.mark.parametrize(("is_", "said"), [each for each in PAIRS if each != LATE])
@virtually
async def test_a_swap_is_named_and_the_right_one_is_good_soon_after_its_return(
    is_: str, said: str, gap_s: float, within_s: float
) -> None:
    is_slow = (is_, said, gap_s) == SLOW
    async with one_starter(make_unit(said, 1, seed=3)) as here:
        right = here.unit
        await asyncio.sleep(20.0)
        here.bus.remove(right)
        await asyncio.sleep(gap_s)
        here.bus.add(device(is_, 4, as_printed))
        await asyncio.sleep(within_s + 10.0 if is_slow else within_s)

        assert len(here.events("identity_mismatch")) == 1
        here.sink.clear()
        await asyncio.sleep(10.0)
        assert good_values(here) == []

        swap(here, right)
        await asyncio.sleep(15.0 if is_slow else 10.0)
        assert here.telemetry.identity_standing is IdentityStatus.MATCHING
        assert here.sink.of(StateRecord)[-1].quality is Quality.GOOD


@pytest.mark.parametrize("gap_s", [0.0, 0.05, 1.0, 2.0])
@pytest.mark.parametrize(("is_", "said"), WEG_PAIRS)
@virtually
async def test_a_device_that_proves_nothing_has_no_good_values_for_long(
    is_: str, said: str, gap_s: float
) -> None:
    """After a gap a refusal may be a late one for 30 s, and names no other family as long."""
    async with one_starter(make_unit(said, 1, seed=3)) as here:
        right = here.unit
        await asyncio.sleep(20.0)
        here.bus.remove(right)
        await asyncio.sleep(gap_s)
        here.bus.add(device(is_, 4, silent_to_fc43))
        await asyncio.sleep(SOON_S + 5.0)
        here.sink.clear()
        await asyncio.sleep(20.0)
        assert good_values(here) == []

        swap(here, right)
        await asyncio.sleep(60.0)  # it may have to wait until it is asked FC43 again
        assert here.sink.of(StateRecord)[-1].quality is Quality.GOOD


@pytest.mark.parametrize("habit", [as_printed, silent_to_fc43])
@pytest.mark.parametrize("after_s", [0.0, 0.05, 0.5, 2.0])
@pytest.mark.parametrize(("is_", "said"), PAIRS)
@virtually
async def test_no_start_is_written_to_a_device_that_was_swapped_in(
    is_: str, said: str, after_s: float, habit: Habit
) -> None:
    async with one_starter(make_unit(said, 1, seed=3)) as here:
        await asyncio.sleep(20.0)
        swap(here, device(is_, 4, habit))
        await asyncio.sleep(after_s)
        here.bus.transcript.clear()
        here.submit("start", "s1")
        await asyncio.sleep(60.0)  # a refusal that may be a late one is believed after 30 s

        assert here.sink.final("s1").phase in (Phase.REJECTED, Phase.FAILED)
        assert writes(here) == []


@pytest.mark.parametrize("habit", [as_printed, silent_to_fc43])
@pytest.mark.parametrize("after", [1, 2])
@pytest.mark.parametrize(("is_", "said"), WEG_PAIRS)
@virtually
async def test_little_is_written_to_a_device_that_is_swapped_in_after_a_write(
    is_: str, said: str, after: int, habit: Habit
) -> None:
    """What follows at once goes out; nothing after a reading, nor what would leave the right one safe."""
    async with one_starter(make_unit(said, 1, seed=3)) as here:
        await asyncio.sleep(20.0)
        here.unit.trip(5)
        await asyncio.sleep(7.0)
        swap_after(here, after, device(is_, 4, habit))
        here.bus.transcript.clear()
        here.submit("reset", "r1")
        await asyncio.sleep(60.0)

        sent = [frame for frame in here.bus.transcript if frame.sender == 0 and frame.data[1] in WRITES]
        assert len(sent) == 1 if after == 1 else len(sent) > 1
        assert sent[-1].start_s - sent[after - 1].start_s < AT_ONCE_S


@pytest.mark.parametrize("after", [2, 3])
@pytest.mark.parametrize("verb", ["reset", "general_enable"])
@pytest.mark.parametrize(("is_", "said"), [("ssw06", "ssw07"), ("ssw07", "ssw06")])
@virtually
async def test_what_another_device_reads_back_confirms_nothing(
    is_: str, said: str, verb: str, after: int
) -> None:
    """It is swapped in after one of the last writes, and its status reads as that of the right one should."""
    async with one_starter(make_unit(said, 1, seed=3)) as here:
        await asyncio.sleep(20.0)
        if verb == "reset":
            here.unit.trip(5)
            await asyncio.sleep(7.0)
        swap_after(here, after, device(is_, 4, as_printed))
        here.submit(verb, "r1", **({} if verb == "reset" else {"value": True}))
        await asyncio.sleep(60.0)

        end = here.sink.final("r1")
        assert (end.phase, end.code) == (Phase.UNCONFIRMED, "identity_mismatch")


@pytest.mark.parametrize("after_s", [9.9, 10.2, 10.6, 11.6, 12.3, 13.0, 14.5])
@pytest.mark.parametrize(("is_", "said"), WEG_PAIRS)
@virtually
async def test_nothing_is_written_while_it_is_open_who_answers(is_: str, said: str, after_s: float) -> None:
    """It is looked again 10 s after the swap; what the other one says is then no measure of the right one."""
    async with one_starter(make_unit(said, 1, seed=3)) as here:
        await asyncio.sleep(20.0)
        swap(here, device(is_, 4, silent_to_fc43))
        await asyncio.sleep(after_s)
        here.bus.transcript.clear()
        here.submit("general_enable", "g1", value=True)
        await asyncio.sleep(60.0)

        assert here.sink.final("g1").phase in (Phase.REJECTED, Phase.FAILED)
        assert writes(here) == []


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_stop_waits_for_no_question(family: str) -> None:
    async with one_starter(make_unit(family, 1, seed=0)) as here:
        await asyncio.sleep(20.0)
        here.submit("start", "s1")
        await asyncio.sleep(0.03)  # who answers is being asked
        here.bus.transcript.clear()
        here.submit("stop", "p1")
        await asyncio.sleep(20.0)

        functions = [pdu[0] for pdu in here.requests()]
        assert not WRITES.isdisjoint(functions[:2])  # after the one that was on the wire at most


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_looking_again_costs_less_than_3_thousandths_of_the_line(family: str) -> None:
    async with one_starter(make_unit(family, 1, seed=0)) as here:
        await asyncio.sleep(60.0)
        here.bus.transcript.clear()
        await asyncio.sleep(600.0)

        asked = [pdu for pdu in here.requests() if pdu == VB00 or is_fc43(pdu)]
        assert len(asked) <= 600.0 / LOOK_AGAIN_S + 1
        each_s = (8 + 7) * TIMING.character_s + 0.020 + 2 * TIMING.silence_s  # ssw07 5.3.1
        assert len(asked) * each_s < 0.003 * 600.0


@pytest.mark.parametrize("deaf_s", [3.0, 10.0])
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_device_that_is_deaf_for_long_after_fc43_becomes_good(
    family: str, deaf_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(habits, "DEAF_S", deaf_s)
    async with one_starter(device(family, 0, deaf_after_fc43)) as here:
        await asyncio.sleep(120.0)
        assert here.sink.of(StateRecord)[-1].quality is Quality.GOOD

        await asyncio.sleep(3600.0)
        assert len(here.events("went_silent")) <= 8  # asked ever less often: after 1, 2, 4, .. minutes
        assert here.sink.of(StateRecord)[-1].quality is Quality.GOOD


@pytest.mark.parametrize("back_s", [1.5, 3.0, 6.0])
@pytest.mark.parametrize("habit", [as_printed, refuses_fc43, silent_to_fc43])
@pytest.mark.parametrize(("is_", "said"), [("ssw06", "ssw07"), ("ssw07", "ssw06"), ("ssw900", "ssw07")])
@virtually
async def test_one_that_goes_and_comes_again_is_not_taken_for_the_right_one(
    is_: str, said: str, habit: Habit, back_s: float
) -> None:
    """What it said the first time must not count as said by the right one, which was there between."""
    async with one_starter(make_unit(said, 1, seed=3)) as here:
        right, wrong = here.unit, device(is_, 4, habit)
        await asyncio.sleep(20.0)
        swap(here, wrong)
        await asyncio.sleep(20.0)
        here.bus.remove(wrong)
        here.bus.add(right)
        await asyncio.sleep(back_s)
        here.bus.remove(right)
        here.bus.add(wrong)
        await asyncio.sleep(1.0)
        here.bus.transcript.clear()
        here.submit("start", "s1")
        await asyncio.sleep(60.0)

        assert writes(here) == []
        assert here.sink.of(StateRecord)[-1].quality is not Quality.GOOD
        assert here.telemetry.identity_standing is not IdentityStatus.MATCHING


@pytest.mark.parametrize("away_s", [9.0, 15.0])
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_one_that_was_without_power_is_good_soon_after(family: str, away_s: float) -> None:
    async with one_starter(make_unit(family, 1, seed=3)) as here:
        unit = here.unit
        await asyncio.sleep(20.0)
        here.bus.remove(unit)
        await asyncio.sleep(away_s)
        here.bus.add(unit)
        await asyncio.sleep(4.0)

        assert here.sink.of(StateRecord)[-1].quality is Quality.GOOD
