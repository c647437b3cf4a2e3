"""What feeds the service watchdog, and what is reported of delays; in virtual time."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.app.health import Health
from gateway.contract import Event, LineRecord, Severity, event_of
from gateway.line.client import LineClient
from gateway.system.stalls import LagMeter
from tests.config.sites import site
from tests.virtual_time import run_virtually

LIMIT_S = 10.0
SITE = site(("every_s = 2.0", "every_s = 2.0\nwatchdog_s = 6"))


class Line:
    """A LineClient as far as Vitals asks."""

    name = "pumps"
    utilisation = 0.5
    watchdogs: dict[str, float] | None = None

    def __init__(self) -> None:
        self.units: dict[int, dict[str, Any]] = {}

    def statistics(self) -> dict[str, Any]:
        rest = {} if self.watchdogs is None else {"watchdogs": self.watchdogs}
        return {"polls": 7, "utilisation": self.utilisation, "units": self.units, **rest}


@dataclass
class World:
    """Stands for the lines, systemd and the publisher around Vitals."""

    moves: bool = True
    steps: int = 0
    fed_s: list[float] = field(default_factory=list)
    reported: list[tuple[str, Severity]] = field(default_factory=list)
    records: list[LineRecord] = field(default_factory=list)
    states: list[tuple[str, str | None]] = field(default_factory=list)
    lag: LagMeter = field(default_factory=LagMeter)
    line: Line = field(default_factory=Line)
    computed: dict[str, dict[str, Any]] = field(default_factory=dict)

    def progress(self) -> dict[str, int]:
        self.steps += self.moves
        return {"pumps": self.steps}

    # Notifier
    def watchdog(self) -> None:
        self.fed_s.append(asyncio.get_running_loop().time())

    def ready(self, status: str) -> None:
        pass

    def status(self, text: str) -> None:
        pass

    # Publisher
    def set_status(self, state: str, reason: str | None = None) -> None:
        self.states.append((state, reason))

    def put(self, record: LineRecord) -> None:
        self.records.append(record)

    def publish_event(self, *event: Any, **fields: Any) -> None:
        said = event[0] if isinstance(event[0], Event) else event_of(*event, **fields)
        self.reported.append((said.code, said.severity))

    def health(self) -> Health:
        line: LineClient = self.line  # type: ignore[assignment] # all that is asked of it
        health = Health(
            progress=self.progress,
            publisher=self,  # type: ignore[arg-type] # all that is asked of it
            sink=self,  # type: ignore[arg-type] # the same
            notifier=self,  # type: ignore[arg-type] # the same
            watchdog_every_s=LIMIT_S / 2,
            lines_lag=self.lag,
            publish_event=self.publish_event,
        )
        health.reconfigure([line], SimpleNamespace(config=SITE, computed=self.computed))  # type: ignore[arg-type]
        return health


async def watched(world: World, *steps: tuple[float, Any]) -> None:
    """Let Vitals run; after each pause do something."""
    running = asyncio.create_task(world.health().run())
    for pause_s, act in steps:
        await asyncio.sleep(pause_s)
        if act is not None:
            act()
    running.cancel()
    await asyncio.wait([running])


def test_a_line_that_stands_still_starves_the_watchdog() -> None:
    world = World()

    def stop() -> None:
        world.moves = False

    run_virtually(watched(world, (10.0, stop), (20.0, None)))

    assert world.fed_s[-1] <= 10.0 + LIMIT_S / 8 + 0.25


def test_a_late_loop_warns_once_and_stands_in_the_statistics(caplog: pytest.LogCaptureFixture) -> None:
    world = World()

    def late() -> None:
        world.lag.note(0.06, 0.0)

    with caplog.at_level(logging.WARNING):
        run_virtually(watched(world, (1.0, late), (1.0, late), (40.0, None)))

    assert caplog.text.count("was 0.060 s late") == 1
    assert world.reported == []
    assert world.records[-1].data["polls"] == 7
    assert world.records[-1].data["lag_s"] == {"line": 0.06, "gateway": 0.0}


def test_a_delay_that_a_starters_watchdog_may_feel_is_an_event_once_a_minute() -> None:
    world = World()

    def late() -> None:
        world.lag.note(2.1, 0.0)

    run_virtually(watched(world, (1.0, late), (1.0, late), (61.0, late), (1.0, None)))

    assert world.reported == [("lag", Severity.ERROR)] * 2


def fill(world: World, utilisation: float) -> Any:
    def act() -> None:
        world.line.utilisation = utilisation

    return act


def test_a_line_without_time_to_spare_is_reported_after_a_minute_and_when_it_is_relieved() -> None:
    world = World(computed={"pumps": {"is_paced": True, "sweep_s": 1.0}})

    run_virtually(watched(world, (5.0, fill(world, 0.99)), (70.0, fill(world, 0.4)), (70.0, None)))

    assert world.reported == [("line_saturated", Severity.WARNING), ("line_relieved", Severity.INFO)]
    assert world.records[-1].data["computed"] == {"is_paced": True, "sweep_s": 1.0}


def test_a_line_that_is_to_be_full_is_not_reported() -> None:
    world = World(computed={"pumps": {"is_paced": False}})

    run_virtually(watched(world, (0.0, fill(world, 1.0)), (200.0, None)))

    assert world.reported == []


def test_what_is_wrong_with_a_cable_is_published_and_reported_when_it_appears_and_goes() -> None:
    world = World()
    counts = {"asked": 0, "corrupted": 0}
    world.line.units = {1: {**counts, "silent": 0, "late": 0, "state": "answering"}}

    def ask(corrupted: int) -> None:
        for unit in world.line.units.values():
            unit["asked"] += 40
            unit["corrupted"] += corrupted

    async def scenario() -> None:
        health = world.health()
        running = asyncio.create_task(health.run())
        for corrupted in [8] * 20 + [0] * 30:
            ask(corrupted)
            await asyncio.sleep(30.0)
        running.cancel()
        await asyncio.wait([running])

    run_virtually(scenario())
    texts = [record.data["cable"]["texts"] for record in world.records]
    assert world.reported == [("cable", Severity.WARNING), ("cable", Severity.INFO)]
    assert texts[0] == texts[-1] == []
    assert ["errors of pump-1" in text for found in texts for text in found].count(True) > 15
    assert world.records[15].data["cable"]["starters"]["pump-1"]["error_rate"] == 0.2
