"""What feeds the service watchdog, and what is reported of delays; in virtual time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.app.health import Health
from gateway.contract import Severity, event_of
from gateway.system.stalls import LagMeter
from tests.config.sites import site
from tests.virtual_time import run_virtually

LIMIT_S = 10.0
SITE = SimpleNamespace(config=site(("every_s = 2.0", "every_s = 2.0\nwatchdog_s = 6")), computed={})


class World:
    """The lines, systemd and the publisher around Health."""

    name = "pumps"
    pace = 1  # steps between two looks

    def __init__(self) -> None:
        self.steps = 0
        self.fed_s: list[float] = []
        self.reported: list[tuple[str, Severity]] = []
        self.records: list[Any] = []
        self.lag = LagMeter()
        self.ready = self.status = self.set_status = lambda *_: None
        self.put = self.records.append

    def progress(self) -> dict[str, int]:
        self.steps += self.pace
        return {self.name: self.steps}

    def statistics(self) -> dict[str, Any]:
        return {"polls": 7, "utilisation": 0.5, "units": {}}

    def watchdog(self) -> None:
        self.fed_s.append(asyncio.get_running_loop().time())

    def publish_event(self, *event: Any, **fields: Any) -> None:
        said = event_of(*event, **fields)
        self.reported.append((said.code, said.severity))

    def run(self, *steps: tuple[float, Callable[[], object]]) -> None:
        """Let Health run; after each pause do something."""
        me: Any = self

        async def main() -> None:
            health = Health(
                progress=self.progress,
                publisher=me,
                sink=me,
                notifier=me,
                watchdog_every_s=LIMIT_S / 2,
                lines_lag=self.lag,
                publish_event=self.publish_event,
            )
            health.reconfigure([me], SITE)  # type: ignore[arg-type] # all that is asked of it
            running = asyncio.create_task(health.run())
            for pause_s, act in steps:
                await asyncio.sleep(pause_s)
                act()
            running.cancel()
            await asyncio.wait([running])

        run_virtually(main())


def test_a_line_that_stands_still_starves_the_watchdog() -> None:
    world = World()

    world.run((10.0, lambda: setattr(world, "pace", 0)), (20.0, lambda: None))

    assert len(world.fed_s) > 3
    assert world.fed_s[-1] <= 10.0 + LIMIT_S / 8 + 0.25


def test_a_late_loop_warns_once_and_is_in_the_statistics(caplog: pytest.LogCaptureFixture) -> None:
    world = World()
    late = 1.0, lambda: world.lag.note(0.06)

    with caplog.at_level(logging.WARNING):
        world.run(late, late, (40.0, lambda: None))

    assert caplog.text.count("was 0.060 s late") == 1
    assert world.reported == []
    assert world.records[-1].data["polls"] == 7
    assert world.records[-1].data["lag_s"] == {"line": 0.06, "gateway": 0.0}


def test_a_delay_that_a_starters_watchdog_may_feel_is_an_event_once_a_minute() -> None:
    world = World()

    world.run(*((pause_s, lambda: world.lag.note(2.1)) for pause_s in (1.0, 1.0, 61.0)), (1.0, lambda: 0))

    assert world.reported == [("lag", Severity.ERROR)] * 2
