"""What comes in, and what of it is taken after the gateway has stood still."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from gateway.clock import ClockWatch
from gateway.mqtt.boot import Boot
from gateway.mqtt.inbox import Inbox
from gateway.mqtt.intake import Incoming
from gateway.mqtt.json_out import rfc3339
from gateway.mqtt.topics import Topics
from gateway.reception import Reception
from gateway.standstill import StandstillWatch
from gateway.starters.records import ResultRecord, Severity
from tests.starters.plant import Plant
from tests.starters.rig import virtually
from tests.virtual_time import VirtualTimeLoop


class Desk:
    """A reception in front of a plant, connected for a second; the machine sleeps by `asleep_s`."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.boot = Boot("run")
        self.boot.connected(plant.clock.now_s())
        self.asleep_s = 0.0
        self.tokens: list[str] = []  # as told again
        self.events: list[tuple[str, Severity, str]] = []
        self.reception = Reception(
            Topics("b"),
            self.boot,
            commander=plant.commander,
            clock=plant.clock,
            clock_watch=ClockWatch("trusted"),
            restate=lambda: self.tokens.append(self.boot.token),
            tell=lambda *event: self.events.append(event),
            standstill=self._watch,
        )

    def _watch(self, on_standstill: Callable[[float], None]) -> StandstillWatch:
        clock = self.plant.clock
        return StandstillWatch(on_standstill, up_s=lambda: clock.now_s() + self.asleep_s, utc_s=clock.utc_s)

    def take(self, verb: str, id_: str, **fields: Any) -> None:
        payload = json.dumps({"id": id_, **fields}).encode()
        self.reception.take(Incoming(f"b/command/pump-1/alice/{verb}", payload))


async def desk() -> Desk:
    made = Desk(await Plant().online())
    looking = asyncio.create_task(made.reception.run())
    await asyncio.sleep(1.0)
    looking.cancel()  # it stands still from here on, whatever the clocks do
    return made


@pytest.mark.parametrize(("asleep_s", "code"), [(0.0, "before_connection"), (3600.0, "expired")])
@virtually
async def test_what_waited_while_the_gateway_stood_still_is_refused(asleep_s: float, code: str) -> None:
    here = await desk()
    boot, issued_at = here.boot.token, rfc3339(here.plant.clock.utc_s())
    await asyncio.sleep(3.0 if not asleep_s else 0.01)
    here.asleep_s = asleep_s  # with the machine: the steady clock does not count that
    here.plant.clock.epoch_s += asleep_s

    here.take("start", "1", boot=boot)
    here.take("start", "2", issued_at=issued_at, ttl_s=60)
    here.take("start", "3", boot=boot, issued_at=issued_at, ttl_s=60)
    await asyncio.sleep(3.0)

    codes = {id_: here.plant.sink.final(id_).code for id_ in ("1", "2", "3")}
    assert codes == {"1": "wrong_boot", "2": code, "3": code}
    assert here.plant.starts() == 0
    assert here.tokens == [here.boot.token] != [boot]
    assert [(code, severity) for code, severity, _ in here.events] == [("stood_still", Severity.WARNING)]


@virtually
async def test_a_stop_that_waited_stops_all_the_same() -> None:
    here = await desk()
    here.plant.machines["pump-1"].turn(is_on=True)
    await asyncio.sleep(30.0)

    here.take("stop", "1")
    await here.plant.wait(3.0)

    assert here.plant.stops() == 1


@virtually
async def test_after_a_standstill_the_new_token_and_what_is_issued_from_then_on_are_fresh() -> None:
    here = await desk()
    await asyncio.sleep(3.0)
    here.take("read", "old", boot="run")

    here.take("start", "1", boot=here.boot.token)
    await here.plant.wait(3.0)
    here.take("stop", "2")
    await here.plant.wait(3.0)
    here.take("start", "3", issued_at=rfc3339(here.plant.clock.utc_s()))
    await here.plant.wait(3.0)

    assert [here.plant.sink.final(id_).code for id_ in "123"] == ["ok", "ok", "ok"]


@virtually
async def test_without_a_standstill_the_token_stays_what_it_is() -> None:
    here = await desk()
    for number in range(100):
        await asyncio.sleep(0.5)
        here.take("read", f"{number}", boot="run", args={"parameter": "P003"})

    assert here.boot.token == "run"
    assert here.events == []


@virtually
async def test_what_is_no_command_is_nobodys() -> None:
    here = await desk()

    here.reception.take(Incoming("b/command/pump-1", b""))
    here.reception.take(Incoming("b/command/pump-1/alice/start", b"no JSON"))
    await asyncio.sleep(1.0)

    assert [each.code for each in here.plant.sink.of(ResultRecord)] == ["bad_json"]


@virtually
async def test_a_start_that_waits_to_be_parsed_is_not_carried_out_after_the_stop_that_overtook_it() -> None:
    here = await desk()
    inbox = Inbox(
        Topics("b"),
        take=here.reception.take,
        refuse=here.plant.commander.refuse_unread,
        now_s=here.plant.clock.now_s,
    )
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    inbox._paid_s = loop.time() + 1.5  # it has parsed a flood

    inbox.put(message("start", "1", boot=here.boot.token, ttl_s=60.0))
    await asyncio.sleep(0.01)
    inbox.put(message("stop", "2"))
    await asyncio.sleep(1.0)
    assert here.plant.sink.final("2").code == "ok"
    await asyncio.sleep(1.0)

    sink = here.plant.sink
    assert sink.phases("1") == [("rejected", "stopped_first")]
    assert here.plant.starts() == 0


def message(verb: str, id_: str, **fields: Any) -> Incoming:
    return Incoming(f"b/command/pump-1/alice/{verb}", json.dumps({"id": id_, **fields}).encode())
