"""A thousand commands a second: all refused in so many words, and a stop among them goes first."""

from __future__ import annotations

import asyncio

from gateway.records import AuditRecord, ResultRecord
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from gateway.system.rate_limits import Rate
from tests.starters.fakes import AT_SPEED, READY, VB01
from tests.starters.plant import Plant
from tests.starters.rig import virtually
from tests.starters.rules import ignore


async def flood(plant: Plant, *, per_s: int, seconds: float, verb: str, clients: tuple[str, ...]) -> None:
    """Send that many commands a second, each with an id of its own."""
    for number in range(int(per_s * seconds)):
        args = {"parameter": "P003"} if verb == "read" else {}
        plant.submit(verb, f"{verb} {number}", client=clients[number % len(clients)], args=args)
        await asyncio.sleep(1 / per_s)
        if number % per_s == 0:
            plant.poll()


@virtually
async def test_excess_is_refused_in_so_many_words_and_no_client_is_forgotten() -> None:
    plant = await Plant().online()
    await flood(plant, per_s=1000, seconds=5.0, verb="read", clients=("alice", "bob", "victor"))
    await plant.wait(2.0)

    results = plant.sink.of(ResultRecord)
    finals = [r for r in results if r.phase.is_final]
    counted = sum(r.values.get("count", 0) for r in finals)
    assert len([r for r in finals if "count" not in r.values]) + counted == 5000
    assert len(results) < 1000
    assert len(plant.sink.of(AuditRecord)) < 1000
    assert {r.id for r in finals if "count" in r.values} == {None}


@virtually
async def test_a_flood_of_stops_stops_and_answers_only_some() -> None:
    plant = await Plant().online()
    plant.machines["pump-1"].set_motor(is_on=True)
    plant.sink.clear()

    await flood(plant, per_s=1000, seconds=3.0, verb="stop", clients=("alice", "bob", "victor"))
    await plant.wait(2.0)

    assert plant.machines["pump-1"].unit.holding[VB01] == READY
    accepted = [r.id for r in plant.sink.of(ResultRecord) if r.phase == "accepted"]
    finals = [r.id for r in plant.sink.of(ResultRecord) if r.phase.is_final and r.phase != "rejected"]
    assert sorted(map(str, accepted)) == sorted(map(str, finals))
    assert len(plant.sink.of(ResultRecord)) < 1500


@virtually
async def test_a_stop_that_is_sent_again_and_again_with_one_id_is_one_stop() -> None:
    plant = await Plant().online()
    plant.machines["pump-1"].set_motor(is_on=True)
    plant.machines["pump-1"].unit.on_write = ignore
    for _ in range(2000):
        plant.submit("stop", "1")
        await asyncio.sleep(0.001)
    await plant.wait(15.0)

    results = plant.sink.of(ResultRecord)
    assert len([r for r in results if r.phase.is_final]) == 1
    assert len(results) < 50


@virtually
async def test_stops_without_an_id_and_those_with_correlation_data_are_distinguished() -> None:
    plant = await Plant().online()
    plant.submit("stop", None)
    plant.submit("stop", None)
    plant.submit("stop", None, client="bob")
    plant.submit("stop", None, correlation=b"7")
    await plant.wait(3.0)

    finals = [(r.client, r.correlation) for r in plant.sink.of(ResultRecord) if r.phase.is_final]
    assert sorted(finals, key=str) == [("alice", None), ("alice", b"7"), ("bob", None)]


@virtually
async def test_a_stop_of_somebody_without_the_right_is_limited_like_anything_else() -> None:
    plant = await Plant().online()
    for number in range(1000):
        plant.submit("stop", f"{number}", client=f"mallory-{number}")
    await plant.wait(1.0)

    assert len(plant.sink.of(ResultRecord)) < 50
    assert plant.stops() == 0


@virtually
async def test_what_the_intake_refuses_is_limited_too() -> None:
    plant = await Plant().online()
    for number in range(1000):
        request = CommandRequest("pump-1", "alice", "start", f"{number}")
        plant.dispatcher.reject(request, "retained", "a retained command is never acted on")
    await plant.wait(1.0)

    codes = [r.code for r in plant.sink.of(ResultRecord)]
    assert len(codes) < 50
    assert set(codes) == {"retained", "too_many"}


@virtually
async def test_no_more_commands_wait_for_a_line_than_it_can_serve_while_they_are_fresh() -> None:
    limits = RateLimits(under_way_on_line=2)
    plant = await Plant(None, "a@x", "b@x", "c@x", "d@y", policy=PolicySettings(limits=limits)).online()
    for name in "abcd":
        plant.submit("start", name, starter=name)
    await plant.wait(5.0)

    assert {name: plant.sink.final(name).code for name in "abcd"} == {
        "a": "ok",
        "b": "ok",
        "c": "too_many",
        "d": "ok",
    }


@virtually
async def test_what_was_only_counted_is_published_before_the_gateway_ends() -> None:
    limits = RateLimits(client=Rate(1.0, 1))
    plant = await Plant(policy=PolicySettings(limits=limits)).online()
    for number in range(10):
        plant.submit("read", f"{number}", args={"parameter": "P003"})

    await plant.dispatcher.close()

    assert [r.values["count"] for r in plant.sink.of(ResultRecord) if "count" in r.values] == [8]
    assert plant.machines["pump-1"].unit.holding[VB01] != AT_SPEED
