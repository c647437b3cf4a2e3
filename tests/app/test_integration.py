"""An integration is begun, fed, reloaded and begun anew; what fails in it fails alone."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast

import pytest

from gateway.app.plugins import Integration, IntegrationHost, IntegrationService, Load
from gateway.app.site import Site
from gateway.contract import AvailabilityRecord, Record
from gateway.system.clock import SystemClock
from tests.virtual_time import run_virtually

RECORD = AvailabilityRecord(starter="pump-1", state="online", since_s=0.0, reason=None)


class Service:
    """Notes what it gets; raises on order."""

    def __init__(self, log: list[Any], site: Any) -> None:
        self.log = log
        self.fault: str = ""
        self.stop = asyncio.Event()
        log.append(("begun", site))

    def put(self, record: Record) -> None:
        if self.fault == "put":
            raise ValueError("ordered")
        self.log.append(record)

    def move(self, site: Site) -> None:
        if self.fault == "move":
            raise ValueError("ordered")
        self.log.append(("moved", site))

    async def run(self) -> None:
        try:
            await self.stop.wait()
            raise ValueError("ordered")
        finally:
            self.log.append("ended")


class Rig:
    """An integration whose sites are plain texts; `off` does not want it."""

    def __init__(self, site: str = "first") -> None:
        self.log: list[Any] = []
        self.events: list[str] = []
        self.services: list[Service] = []
        self.is_installed = self.is_polling = True
        self.integration = Integration(
            "sample",
            IntegrationHost(
                cast("Site", site),
                SystemClock(),
                lambda: self.is_polling,
                lambda code, *_: self.events.append(code),
                self._at_once,
            ),
            is_wanted=lambda each: cast("str", each) != "off",
            load=self._load,
            missing="pip install sample",
        )

    async def _at_once(self, load: Load) -> Callable[[Site], IntegrationService]:
        return load()

    def _load(self) -> Callable[[Site], IntegrationService]:
        if not self.is_installed:
            raise ImportError("sample")
        return self._make

    def _make(self, site: Site) -> IntegrationService:
        self.services.append(Service(self.log, site))
        return self.services[-1]

    def move(self, site: str) -> None:
        self.integration.move(cast("Site", site))


def _run(scenario: Callable[[Rig], Any], site: str = "first") -> Rig:
    async def main() -> Rig:
        rig = Rig(site)
        task = asyncio.create_task(rig.integration.run())
        await asyncio.sleep(0.1)
        await scenario(rig)
        await asyncio.sleep(0.1)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return rig

    return run_virtually(main())


@pytest.mark.parametrize("fault", ["put", "move", "run"])
def test_a_bug_in_it_ends_it_alone_and_it_begins_anew(fault: str) -> None:
    async def scenario(rig: Rig) -> None:
        service = rig.services[0]
        service.fault = fault
        if fault == "put":
            rig.integration.put(RECORD)
        elif fault == "move":
            rig.move("second")
        else:
            service.stop.set()
        await asyncio.sleep(0.1)
        rig.integration.put(RECORD)  # no one takes it now
        await asyncio.sleep(2.0)
        rig.integration.put(RECORD)

    site = "second" if fault == "move" else "first"
    assert _run(scenario).log == [("begun", "first"), "ended", ("begun", site), RECORD, "ended"]


def test_what_is_not_installed_is_said_once_until_the_next_configuration() -> None:
    async def scenario(rig: Rig) -> None:
        rig.is_installed = False
        rig.move("off")
        await asyncio.sleep(0.1)
        rig.move("second")
        await asyncio.sleep(10.0)
        assert rig.events == ["sample_away"]
        rig.is_installed = True
        rig.move("third")

    assert _run(scenario).log[-2:] == [("begun", "third"), "ended"]


def test_what_is_not_wanted_any_more_when_the_lines_poll_never_begins() -> None:
    async def scenario(rig: Rig) -> None:
        rig.is_polling = False
        rig.move("second")
        await asyncio.sleep(1.0)
        rig.move("off")
        rig.is_polling = True
        await asyncio.sleep(2.0)

    assert _run(scenario, "off").log == []
