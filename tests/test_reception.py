"""What comes in, and what of it is taken after the gateway has stood still."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from gateway.clock import ClockWatch
from gateway.mqtt.boot import Boot
from gateway.mqtt.freshness import Tokens
from gateway.mqtt.intake import Incoming
from gateway.mqtt.json_out import rfc3339
from gateway.mqtt.topics import Topics
from gateway.reception import Reception
from gateway.standstill import StandstillWatch
from gateway.starters.records import ResultRecord, Severity
from gateway.starters.rights import Operator
from gateway.system.clock_steps import Reading
from tests.starters.plant import OPERATORS, Plant
from tests.starters.rig import virtually


class Desk:
    """A reception in front of a plant, connected for a second; the machine sleeps by `asleep_s`."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.boot = Boot("run")
        self._tokens = Tokens(self.boot)
        self.boot.connected(plant.clock.now_s())
        self.asleep_s = 0.0
        self.tokens: list[str] = []  # as told again
        self.events: list[tuple[str, Severity, str]] = []
        self.reception = Reception(
            Topics("b"),
            self._tokens,
            commander=plant.commander,
            clock=plant.clock,
            clock_watch=ClockWatch("trusted", ask=lambda: False, read=self._read_clocks),
            restate=lambda: self.tokens.append(self.boot.token),
            tell=lambda *event: self.events.append(event),
            standstill=self._watch,
        )

    def token(self) -> str:
        return self._tokens.issue(self.plant.clock.now_s())

    def _read_clocks(self) -> Reading:
        clock = self.plant.clock
        return Reading(clock.now_s() + self.asleep_s, clock.utc_s())

    def _watch(self, on_standstill: Callable[[float], None]) -> StandstillWatch:
        clock = self.plant.clock
        return StandstillWatch(on_standstill, up_s=lambda: clock.now_s() + self.asleep_s, utc_s=clock.utc_s)

    def take(self, verb: str, id_: str, starter: str = "pump-1", **fields: Any) -> None:
        payload = json.dumps({"id": id_, **fields}).encode()
        self.reception.take(Incoming(f"b/command/{starter}/alice/{verb}", payload))


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
    boot, token, issued_at = here.boot.token, here.token(), rfc3339(here.plant.clock.utc_s())
    await asyncio.sleep(3.0 if not asleep_s else 0.01)
    here.asleep_s = asleep_s  # with the machine: the steady clock does not count that
    here.plant.clock.epoch_s += asleep_s

    here.take("start", "1", boot=boot)
    here.take("start", "2", issued_at=issued_at, ttl_s=60)
    here.take("start", "3", boot=boot, issued_at=issued_at, ttl_s=60)
    here.take("start", "4", token=token, ttl_s=60)
    here.take("read", "5", boot=boot)
    await asyncio.sleep(3.0)

    codes = {id_: here.plant.sink.final(id_).code for id_ in "12345"}
    assert codes == {"1": "wrong_boot", "2": code, "3": code, "4": "not_fresh", "5": "wrong_boot"}
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

    here.take("start", "1", token=here.token())
    await here.plant.wait(3.0)
    here.take("stop", "2")
    await here.plant.wait(3.0)
    here.take("start", "3", issued_at=rfc3339(here.plant.clock.utc_s()))
    await here.plant.wait(3.0)

    assert [here.plant.sink.final(id_).code for id_ in "123"] == ["ok", "ok", "ok"]


@pytest.mark.parametrize("step_s", [-20.0, 20.0])
@virtually
async def test_a_clock_that_was_set_makes_no_old_command_fresh(step_s: float) -> None:
    here = await desk()
    true_utc_s = here.plant.clock.utc_s()
    here.plant.clock.epoch_s += step_s

    here.take("start", "late", issued_at=rfc3339(true_utc_s - 20.0))
    here.take("start", "now", issued_at=rfc3339(true_utc_s))
    before = here.plant.starts()
    here.take("start", "by token", token=here.token())
    await here.plant.wait(3.0)

    late, now = here.plant.sink.final("late"), here.plant.sink.final("now")
    by = "back" if step_s < 0 else "ahead"
    assert (before, here.plant.starts()) == (0, 1)
    assert late.code == now.code == "not_fresh"
    assert late.text.startswith(f"this gateway's clock was set {by} by 20.0 s, so issued_at does not count")
    assert here.plant.sink.final("by token").code == "ok"


@virtually
async def test_the_boot_alone_starts_nothing_but_for_an_operator_whose_entry_says_so() -> None:
    old_client = Operator("alice", ("start",), ("pump-2",), "boot")
    here = Desk(await Plant(operators=(*OPERATORS, old_client)).online())

    here.take("start", "1", boot="run")
    here.take("start", "2", starter="pump-2", boot="run")
    here.take("read", "3", boot="run", args={"parameter": "P003"})
    await here.plant.wait(3.0)

    codes = [here.plant.sink.final(id_).code for id_ in "123"]
    assert codes == ["not_fresh", "ok", "ok"]


@virtually
async def test_a_start_whose_token_is_old_when_it_comes_expires_within_the_gateway_as_well() -> None:
    here = await desk()
    token = here.token()
    await asyncio.sleep(1.5)
    verdicts: list[float | None] = []
    here.plant.commander.submit = lambda request: verdicts.append(request.expires_s)  # type: ignore[method-assign]

    here.take("start", "1", token=token)

    assert verdicts == [pytest.approx(here.plant.clock.now_s() - 1.5 + 5.0)]


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
