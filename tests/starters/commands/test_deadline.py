"""A command has one deadline: its own time to be written, the family's to be seen, then its end."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass, replace

import pytest

from gateway.families.profile.load import FAMILIES
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil
from gateway.records import Phase, ResultRecord
from gateway.sim.bus.faults import Reply
from gateway.sim.factory import make_unit
from gateway.starters.commands.stop import DEADLINE_S, LAST_READING_S
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from gateway.system.rate_limits import Rate
from tests.starters.fakes import RUN_COIL
from tests.starters.large_line import large_line
from tests.starters.one_starter import OneStarter, one_starter
from tests.starters.rig import virtually
from tests.starters.rules import ready

TTL_S = 5.0
SEEN_S = 3.0  # of a start, whatever the family, but for an SST
SST_SEEN_S = 5.0
TAKEN_BACK_S = 3.0
SLACK_S = 0.7  # of which the last reading may take 0.5 s
PARAMETER = {"ssw06": "P003", "ssw07": "P003", "ssw900": "S1.1.1", "sst": "R14"}
MANY = PolicySettings(limits=RateLimits(client=Rate(1000.0, 1000), everyone=Rate(1000.0, 1000)))


@dataclass(frozen=True)
class LateBy:
    """Answers after a time between these."""

    least_s: float
    most_s: float

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        """Return the reply after that time."""
        return (replace(reply, after_s=dice.uniform(self.least_s, self.most_s)),)


async def end_of(here: OneStarter, verb: str, id_: str, **args: str) -> tuple[float, ResultRecord]:
    """Send a command; return how long its final result took, and that."""
    began_s = asyncio.get_running_loop().time()
    here.dispatcher.submit(
        CommandRequest("pump", "alice", verb, id_, args, received_s=began_s, expires_s=began_s + TTL_S)
    )
    while True:
        await asyncio.sleep(0.01)
        for each in here.sink.of(ResultRecord):
            if each.id == id_ and each.phase.is_final:
                return asyncio.get_running_loop().time() - began_s, each


@pytest.mark.parametrize(("late", "chance"), [(LateBy(0.2, 3.0), 0.05), (LateBy(0.25, 0.25), 0.3)])
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_start_behind_late_replies_has_its_end_in_its_time(
    family: str, late: LateBy, chance: float
) -> None:
    seen_s = SST_SEEN_S if family == "sst" else SEEN_S
    async with one_starter(make_unit(family, 1, seed=0)) as here:
        await asyncio.sleep(10.0)
        here.bus.impair(1, late, chance=chance)
        for number in range(12):
            took_s, final = await end_of(here, "start", f"s{number}")
            here.submit("stop", f"p{number}")
            await asyncio.sleep(12.0)

            assert took_s <= TTL_S + seen_s + TAKEN_BACK_S + SLACK_S, final
            assert final.phase is not Phase.REJECTED or took_s <= TTL_S + SLACK_S, final


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_start_after_three_late_replies_is_carried_out(family: str, seed: int) -> None:
    async with one_starter(make_unit(family, 1, seed=0)) as here:
        await asyncio.sleep(10.0 + seed / 6)
        here.bus.impair(1, LateBy(0.25, 0.25), count=3)

        took_s, final = await end_of(here, "start", "s1")

        assert final.phase is Phase.CONFIRMED, final
        assert took_s <= TTL_S + SEEN_S


@pytest.mark.parametrize("family", FAMILIES)
@virtually
async def test_a_read_of_a_starter_whose_replies_are_late_or_lost_frees_it_in_its_time(family: str) -> None:
    async with one_starter(make_unit(family, 1, seed=0)) as here:
        await asyncio.sleep(10.0)
        here.bus.impair(1, LateBy(0.25, 0.25))

        for number in range(4):
            took_s, final = await end_of(here, "read", f"r{number}", parameter=PARAMETER[family])

            assert took_s <= TTL_S + SLACK_S
            assert final.code in {"ok", "expired", "no_answer", "offline"}


@pytest.mark.parametrize("baud", [9600, 19200])
@virtually
async def test_the_first_minutes_of_120_starters_that_are_polled_without_a_pause_delay_no_command(
    baud: int,
) -> None:
    async with large_line(120, every_s=0.0, baud=baud, settings=MANY) as here:
        chance, sent = random.Random(1), {}
        for number in range(240):
            address, id_ = chance.randrange(1, 121), f"c{number}"
            verb = chance.choice(("start", "read"))
            args = {"parameter": "P003"} if verb == "read" else {}
            sent[id_] = (verb, address, here.clock.now_s())
            here.submit(verb, id_, address, args=args, expires_s=here.clock.now_s() + TTL_S)
            await asyncio.sleep(0.5)
        await asyncio.sleep(15.0)

        for id_, (verb, address, at_s) in sent.items():
            ended_s, final = here.end(id_, address)
            assert final.code in {"ok", "offline", "identity_unknown", "motor_running"}, (id_, verb, final)
            assert ended_s - at_s <= (1.5 if verb == "read" else 5.0), (id_, verb, final)


@virtually
async def test_a_start_that_the_line_never_takes_expires_and_its_starter_is_free_for_the_next() -> None:
    rig = await ready()
    await rig.line._bus.acquire()

    rig.submit("start", expires_s=rig.clock.now_s() + TTL_S)
    await asyncio.sleep(TTL_S + SLACK_S)
    assert (rig.sink.final("1").phase, rig.sink.final("1").code) == (Phase.REJECTED, "expired")
    rig.line._bus.release()
    rig.submit("start", "2", expires_s=rig.clock.now_s() + TTL_S)
    await asyncio.sleep(3.0)

    assert rig.sink.final("2").phase is Phase.CONFIRMED
    assert rig.starts() == 1


@virtually
async def test_a_start_that_was_acknowledged_and_cannot_be_read_back_is_unconfirmed_at_its_deadline() -> None:
    rig = await ready()

    def hold(request: Request) -> None:
        if isinstance(request, WriteCoil) and request.address == RUN_COIL and request.is_on:
            rig.tasks.append(asyncio.ensure_future(take_the_line()))  # once the write is answered

    async def take_the_line() -> None:
        await rig.line._bus.acquire()

    rig.line.rules.append(hold)
    rig.submit("start", expires_s=rig.clock.now_s() + TTL_S)
    await asyncio.sleep(SEEN_S + TAKEN_BACK_S + SLACK_S)

    final = rig.sink.final("1")
    assert (final.phase, final.code) == (Phase.UNCONFIRMED, "not_seen")
    assert "may be turning" in final.text
    rig.submit("read", "2", args={"parameter": "P003"})
    assert "busy" not in [code for _, code in rig.sink.phases("2")]


@virtually
async def test_a_stop_whose_reading_never_ends_has_its_own_end_soon_after_its_deadline() -> None:
    rig = await ready()
    rig.submit("stop")
    await asyncio.sleep(0.03)
    await rig.line._bus.acquire()

    await asyncio.sleep(DEADLINE_S + LAST_READING_S + SLACK_S)

    assert rig.sink.final("1").phase is Phase.UNCONFIRMED
