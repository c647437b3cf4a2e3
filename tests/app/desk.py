"""Incoming commands in front of a plant, with a machine that sleeps on order."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from gateway.app.incoming import IncomingCommands
from gateway.mqtt.contract.commands import Incoming
from gateway.mqtt.contract.freshness import RunToken, Tokens
from gateway.mqtt.contract.topics import Topics
from gateway.system.clock import ClockWatch
from gateway.system.clock_steps import ClockReading
from gateway.system.stalls import SuspendWatch
from tests.starters.plant import Plant


class Desk:
    """Incoming commands in front of a plant, connected for a second; the machine sleeps by `asleep_s`."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.boot = RunToken("run")
        self._tokens = Tokens(self.boot)
        self.boot.connected(plant.clock.now_s() - 60.0)  # a minute ago
        self.asleep_s = 0.0
        self.tokens: list[str] = []  # as reported again
        self.events: list[tuple[Any, ...]] = []
        self.standstill = self._watch()
        self.incoming = IncomingCommands(
            Topics("b"),
            self._tokens,
            dispatcher=plant.dispatcher,
            clock=plant.clock,
            clock_watch=ClockWatch("trusted", ask=lambda: False, read=self._read_clocks),
            restate=lambda: self.tokens.append(self.boot.token),
            publish_event=lambda *event: self.events.append(event),
            suspend_watch=self.standstill,
        )

    def token(self) -> str:
        return self._tokens.issue(self.plant.clock.now_s())

    def _read_clocks(self) -> ClockReading:
        clock = self.plant.clock
        return ClockReading(clock.now_s() + self.asleep_s, clock.utc_s())

    def _watch(self) -> SuspendWatch:
        clock = self.plant.clock
        return SuspendWatch(clock.now_s, up_s=lambda: clock.now_s() + self.asleep_s, utc_s=clock.utc_s)

    def take(self, verb: str, id_: str, starter: str = "pump-1", **fields: Any) -> None:
        payload = json.dumps({"id": id_, **fields}).encode()
        self.incoming.take(Incoming(f"b/command/{starter}/alice/{verb}", payload))


async def desk() -> Desk:
    made = Desk(await Plant().online())
    looking = asyncio.create_task(made.incoming.run())
    await asyncio.sleep(1.0)
    looking.cancel()  # it stands still from here on, whatever the clocks do
    return made
