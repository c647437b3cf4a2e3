"""A host's writes on their whole way: through the rules of all commands to the starter."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.mqtt.contract.commands import Incoming, Rejection
from gateway.mqtt.contract.topics import Topics
from gateway.records import AuditRecord, ResultRecord
from gateway.sparkplug.commands import CommandMapper, DeviceCommand
from gateway.sparkplug.payload import decoded_command
from gateway.starters.policy.start_rules import RuleSet
from gateway.system.clock import ClockWatch
from tests.app.desk import Desk, desk
from tests.sparkplug.support import dcmd, write
from tests.starters.plant import Plant
from tests.starters.rig import virtually

TWO_STEP = {"pump-1": RuleSet(two_step=frozenset({"start"}))}


def take(here: Desk, name: str, *, age_s: float = 0.0, is_retained: bool = False) -> None:
    """Have a write arrive that is so old; the birth was a minute ago."""
    utc_s = here.plant.clock.utc_s()
    command = decoded_command(dcmd(write(name), time_s=utc_s - age_s))
    asked = DeviceCommand("pump-1", command, is_retained, utc_s, utc_s - 60.0)
    for each in CommandMapper(Topics("b"), "alice", ttl_s=5.0).judge(asked):
        if isinstance(each, Rejection):
            here.plant.dispatcher.reject(each.request, each.code, each.text)
        else:
            here.incoming.take(each)


def codes(here: Desk) -> list[tuple[str, str]]:
    finals = [each for each in here.plant.sink.of(ResultRecord) if each.phase.is_final]
    return [(str(each.phase), each.code) for each in finals]


@virtually
async def test_a_start_and_a_stop_reach_the_starter_in_the_operators_name() -> None:
    here = await desk()

    take(here, "Command/Start", age_s=0.5)
    await here.plant.wait(3.0)
    take(here, "Command/Stop", age_s=100.0)
    await here.plant.wait(3.0)

    assert (here.plant.starts(), here.plant.stops()) == (1, 1)
    audits = here.plant.sink.of(AuditRecord)
    assert {(each.client, each.source) for each in audits} == {("alice", "sparkplug")}
    assert all((each.id or "").startswith("spb-") for each in here.plant.sink.of(ResultRecord))


@virtually
async def test_the_same_start_twice_is_written_once() -> None:
    here = await desk()
    command = decoded_command(dcmd(write("Command/Start"), time_s=here.plant.clock.utc_s()))
    for _ in range(3):
        utc_s = here.plant.clock.utc_s()
        asked = DeviceCommand("pump-1", command, False, utc_s, 0.0)
        for each in CommandMapper(Topics("b"), "alice", ttl_s=60.0).judge(asked):
            assert isinstance(each, Incoming)
            here.incoming.take(each)
        await here.plant.wait(4.0)

    assert here.plant.starts() == 1


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"age_s": 5.1}, "expired"),
        ({"age_s": -2.1}, "not_fresh"),
        ({"age_s": 61.0}, "before_connection"),
        ({"is_retained": True}, "retained"),
    ],
)
def test_a_start_that_is_not_fresh_is_refused(options: dict[str, Any], code: str) -> None:
    @virtually
    async def scenario() -> None:
        here = await desk()
        take(here, "Command/Start", **options)
        await here.plant.wait(3.0)

        assert codes(here) == [("rejected", code)]
        assert here.plant.starts() == 0

    scenario()


@virtually
async def test_without_a_synchronised_clock_a_start_is_refused_and_a_stop_is_not() -> None:
    here = await desk()
    watch = ClockWatch("untrusted", ask=lambda: False, read=here._read_clocks)
    here.incoming._clock_watch = watch

    take(here, "Command/Start")
    take(here, "Command/Stop")
    await here.plant.wait(3.0)

    assert codes(here)[0] == ("rejected", "not_fresh")
    assert (here.plant.starts(), here.plant.stops()) == (0, 1)


@virtually
async def test_a_retained_stop_is_treated_as_on_the_gateways_own_topics() -> None:
    here = await desk()

    take(here, "Command/Stop", is_retained=True)
    await here.plant.wait(3.0)

    assert codes(here) == [("rejected", "retained")]


@virtually
async def test_a_starter_that_demands_a_selection_refuses_the_start() -> None:
    here = Desk(await Plant(TWO_STEP).online())

    take(here, "Command/Start")
    await here.plant.wait(3.0)

    assert codes(here) == [("rejected", "select_first")]
    assert here.plant.starts() == 0


@pytest.mark.parametrize(("after_birth_s", "code"), [(1.9, "before_connection"), (2.1, "ok")])
@virtually
async def test_a_start_that_may_have_been_written_before_the_birth_is_refused(
    after_birth_s: float, code: str
) -> None:
    """The host's clock may be 2 s ahead, and a stop of before the birth may not be known any more."""
    here = await desk()
    utc_s = here.plant.clock.utc_s()
    command = decoded_command(dcmd(write("Command/Start"), time_s=utc_s))

    for each in CommandMapper(Topics("b"), "alice", ttl_s=5.0).judge(
        DeviceCommand("pump-1", command, False, utc_s, utc_s - after_birth_s)
    ):
        if isinstance(each, Rejection):
            here.plant.dispatcher.reject(each.request, each.code, each.text)
        else:
            here.incoming.take(each)
    await here.plant.wait(3.0)

    assert codes(here)[-1][1] == code
