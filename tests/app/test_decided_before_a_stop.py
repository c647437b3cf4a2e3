"""A start that was, or may have been, decided upon before a stop, and arrives after that stop's end."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.topics import Topics
from gateway.records import ResultRecord, rfc3339
from gateway.sparkplug.commands import CommandMapper, DeviceCommand
from gateway.sparkplug.payload import decoded_command
from gateway.starters.policy.rights import Operator
from gateway.starters.policy.start_rules import PolicySettings
from tests.app.desk import Desk
from tests.sparkplug.support import dcmd, write
from tests.starters.plant import OPERATORS, Plant
from tests.starters.rig import virtually

WAYS = ("token", "issued_at", "token and issued_at", "dcmd", "web")
HALL = PolicySettings(groups={"hall": ("pump-1", "pump-2")})


class Wish:
    """A command that is decided upon now, and arrives when it is sent."""

    def __init__(self, here: Desk, way: str, verb: str = "start") -> None:
        self.here, self.way, self.verb = here, way, verb
        self.issued_s = here.plant.clock.utc_s()
        self.token = "" if way in ("issued_at", "dcmd") else here.token()

    def send(self, **more: Any) -> None:
        fields: dict[str, Any] = {"id": "late", "ttl_s": 10.0, **more}
        if self.token:
            fields["token"] = self.token
        if "issued_at" in self.way:
            fields["issued_at"] = rfc3339(self.issued_s)
        topic = f"b/command/pump-1/alice/{self.verb}"
        source = "web" if self.way == "web" else ""
        incoming = Incoming(topic, json.dumps(fields).encode(), source=source)
        self.here.incoming.take(self._from_host() if self.way == "dcmd" else incoming)

    def _from_host(self) -> Incoming:
        command = decoded_command(dcmd(write("Command/Start"), time_s=self.issued_s))
        asked = DeviceCommand("pump-1", command, False, self.here.plant.clock.utc_s(), self.issued_s - 60.0)
        (incoming,) = CommandMapper(Topics("b"), "alice", ttl_s=10.0).judge(asked)
        assert isinstance(incoming, Incoming)
        return incoming


async def running(*operators: Operator) -> Desk:
    """Return a desk whose first pump runs, connected for a while."""
    here = Desk(await Plant(policy=HALL, operators=(*OPERATORS, *operators)).online())
    asyncio.get_running_loop().create_task(here.incoming.run())
    here.plant.machines["pump-1"].set_motor(is_on=True)
    await here.plant.wait(3.0)
    return here


async def stop(here: Desk, target: str = "pump-1") -> None:
    """Stop it and see that it has stopped."""
    here.take("stop", "stop", starter=target)
    await here.plant.wait(0.5)
    ends = [each for each in here.plant.sink.of(ResultRecord) if each.phase.is_final and each.verb == "stop"]
    assert {each.code for each in ends} == {"ok"}


def end(here: Desk) -> str:
    """Return how the command that was no stop ended."""
    (final,) = [r for r in here.plant.sink.of(ResultRecord) if r.phase.is_final and r.verb != "stop"]
    return final.code


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("target", ["pump-1", "hall"])
def test_it_is_refused_whichever_way_it_comes_and_the_motor_stays_at_rest(way: str, target: str) -> None:
    @virtually
    async def scenario() -> None:
        here = await running()
        late = Wish(here, way)
        await here.plant.wait(0.5)
        await stop(here, target)

        late.send()
        await here.plant.wait(3.0)

        assert (end(here), here.plant.starts()) == ("stopped_first", 0)

    scenario()


@pytest.mark.parametrize(
    ("way", "pause_s"), [(way, 0.0 if "token" in way or way == "web" else 2.0) for way in WAYS]
)
def test_a_start_that_is_decided_upon_after_the_stop_starts(way: str, pause_s: float) -> None:
    @virtually
    async def scenario() -> None:
        here = await running()
        await stop(here)  # which takes half a second
        await here.plant.wait(pause_s)

        Wish(here, way).send()
        await here.plant.wait(3.0)

        assert (end(here), here.plant.starts()) == ("ok", 1)

    scenario()


@pytest.mark.parametrize("way", ["issued_at", "dcmd"])
def test_without_a_token_it_must_be_dated_2_s_after_the_stop_since_the_senders_clock_may_be_ahead(
    way: str,
) -> None:
    @virtually
    async def scenario() -> None:
        here = await running()
        ahead = Wish(here, way)
        ahead.issued_s += 1.9  # by a clock that is taken as right
        await stop(here)

        ahead.send()
        await here.plant.wait(3.0)

        assert (end(here), here.plant.starts()) == ("stopped_first", 0)
        assert "must be dated 2 s after the stop" in here.plant.sink.of(ResultRecord)[-1].text

    scenario()


@virtually
async def test_a_selection_that_was_decided_upon_before_the_stop_is_refused_too() -> None:
    """A program that operates as soon as it has selected takes a new token for that."""
    here = await running()
    select = Wish(here, "token", "select")
    await here.plant.wait(0.5)
    await stop(here)

    select.send(args={"verb": "start"})
    await here.plant.wait(0.5)
    assert end(here) == "stopped_first"

    here.take("select", "again", token=here.token(), args={"verb": "start"})
    here.take("select", "reset", token=select.token, args={"verb": "reset"})
    codes = {each.id: each.code for each in here.plant.sink.of(ResultRecord) if each.phase.is_final}
    assert (codes["again"], codes["reset"]) == ("ok", "ok")


@virtually
async def test_a_token_that_is_new_does_not_save_a_command_that_was_issued_before_the_stop() -> None:
    here = await running()
    late = Wish(here, "token and issued_at")
    await here.plant.wait(0.5)
    await stop(here)

    late.token = here.token()
    late.send()
    await here.plant.wait(3.0)

    assert (end(here), here.plant.starts()) == ("stopped_first", 0)


@virtually
async def test_a_refused_one_stays_refused_and_a_new_token_with_a_new_id_starts() -> None:
    here = await running()
    late = Wish(here, "token")
    await here.plant.wait(0.5)
    await stop(here)
    late.send()
    late.token = here.token()
    late.send()
    await here.plant.wait(3.0)
    assert here.plant.starts() == 0
    assert "take a new token" in here.plant.sink.of(ResultRecord)[-1].text

    late.send(id="new")
    await here.plant.wait(3.0)

    assert (here.plant.sink.final("new").code, here.plant.starts()) == ("ok", 1)


@virtually
async def test_the_stop_of_another_starter_refuses_nothing() -> None:
    here = await running()
    await stop(here)
    start = Wish(here, "token")
    here.take("stop", "other", starter="pump-2")
    await here.plant.wait(0.5)

    start.send()
    await here.plant.wait(3.0)

    assert (end(here), here.plant.starts()) == ("ok", 1)


@pytest.mark.parametrize(
    ("verb", "args", "code"),
    [
        ("read", {"parameter": "P003"}, "ok"),
        ("reset", {}, "no_fault_to_reset"),
        ("jog", {"value": False}, "ok"),
        ("general_enable", {"value": False}, "ok"),
        ("jog", {"value": True}, "stopped_first"),
        ("general_enable", {"value": True}, "stopped_first"),
        ("direction", {"value": "reverse"}, "stopped_first"),
        ("local_remote", {"value": "local"}, "stopped_first"),
    ],
)
def test_what_can_move_the_motor_is_refused_and_what_cannot_is_not(
    verb: str, args: dict[str, Any], code: str
) -> None:
    @virtually
    async def scenario() -> None:
        here = await running(Operator("alice", ("*",), ("*",)))
        late = Wish(here, "token", verb)
        await here.plant.wait(0.5)
        await stop(here)

        late.send(args=args)
        await here.plant.wait(9.0)

        assert (end(here) == "stopped_first") is (code == "stopped_first"), end(here)

    scenario()
