"""A plugin is begun, fed, reloaded and begun again; what fails in it fails alone."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.app import plugins
from gateway.app.plugins import MOST, PluginQueue, PluginRunner
from gateway.contract import AvailabilityRecord, EventCode, Latest, Quality, ValueRecord, event_of
from tests.virtual_time import run_virtually

RECORD = AvailabilityRecord(starter="pump-1", state="online", since_s=0.0, reason=None)
MISSING = event_of(EventCode.WEB_AWAY, "missing")


def value(number: int, point: str = "current") -> ValueRecord:
    return ValueRecord(
        starter="p", point=point, value=number, unit="A", quality=Quality.GOOD, time_s=0.0, seq=number
    )


class Sample:
    """Notes what it gets; raises on order."""

    def __init__(self, log: list[Any], settings: str) -> None:
        self.log = log
        self.fault = ""
        self.stop = asyncio.Event()
        log.append(("begun", settings))

    def put(self, record: Any) -> None:
        if self.fault == "put":
            raise ValueError("ordered")
        self.log.append(record)

    def reconfigure(self, settings: str) -> None:
        if self.fault == "reconfigure":
            raise ValueError("ordered")
        self.log.append(("reconfigured", settings))

    async def run(self) -> None:
        try:
            await self.stop.wait()
            raise ValueError("ordered")
        finally:
            self.log.append("ended")


class Rig:
    """A plugin whose sites are plain texts; `off` does not want it."""

    MISSING = MISSING

    def __init__(self, monkeypatch: pytest.MonkeyPatch, site: str) -> None:
        self.log: list[Any] = []
        self.events: list[Any] = []
        self.begun: list[Sample] = []
        self.is_installed = self.is_polling = True
        self.is_slow = False  # to be imported
        monkeypatch.setattr(plugins, "module_of", lambda _: self)
        gateway: Any = SimpleNamespace(
            in_thread=self._in_thread,
            latest=Latest(),
            progress=lambda: {"line": self.is_polling},
            publish_event=lambda *event, **fields: self.events.append((event, fields)),
        )
        there: Any = site
        self.runner = PluginRunner("sample", there, gateway)

    async def _in_thread(self, load: Callable[[], Any]) -> Any:
        await asyncio.sleep(1.0 if self.is_slow else 0.0)
        return load()

    @staticmethod
    def settings_of(site: str) -> str | None:
        return None if site == "off" else site

    def load(self, _: object) -> Callable[[str], Sample]:
        if not self.is_installed:
            raise ImportError("sample")
        return self._make

    def _make(self, settings: str) -> Sample:
        self.begun.append(Sample(self.log, settings))
        return self.begun[-1]

    def reload(self, site: Any) -> None:
        self.runner.reconfigure(site)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Rig]:
    def play(scenario: Callable[[Rig], Any], site: str = "first") -> Rig:
        async def main() -> Rig:
            rig = Rig(monkeypatch, site)
            task = asyncio.create_task(rig.runner.run())
            await asyncio.sleep(0.1)
            await scenario(rig)
            await asyncio.sleep(0.1)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            return rig

        return run_virtually(main())

    return play


@pytest.mark.parametrize("fault", ["put", "reconfigure", "run"])
def test_a_bug_in_it_ends_it_alone_and_it_begins_again(fault: str, run: Callable[..., Rig]) -> None:
    async def scenario(rig: Rig) -> None:
        plugin = rig.begun[0]
        plugin.fault = fault
        if fault == "put":
            rig.runner.put(RECORD)
        elif fault == "reconfigure":
            rig.reload("second")
        else:
            plugin.stop.set()
        await asyncio.sleep(0.1)
        rig.runner.put(RECORD)  # nothing takes it now
        await asyncio.sleep(2.0)
        rig.runner.put(RECORD)

    site = "second" if fault == "reconfigure" else "first"
    assert run(scenario).log == [("begun", "first"), "ended", ("begun", site), RECORD, "ended"]


def test_a_missing_package_is_said_once_until_the_next_configuration(run: Callable[..., Rig]) -> None:
    async def scenario(rig: Rig) -> None:
        rig.is_installed = False
        rig.reload("off")
        await asyncio.sleep(0.1)
        rig.reload("second")
        await asyncio.sleep(10.0)
        assert rig.events == [((MISSING,), {})]
        rig.is_installed = True
        rig.reload("third")

    assert run(scenario).log[-2:] == [("begun", "third"), "ended"]


def test_what_is_not_wanted_any_more_when_the_lines_poll_never_begins(run: Callable[..., Rig]) -> None:
    async def scenario(rig: Rig) -> None:
        rig.is_polling = False
        rig.reload("second")
        await asyncio.sleep(1.0)
        rig.reload("off")
        rig.is_polling = True
        await asyncio.sleep(2.0)

    assert run(scenario, "off").log == []


def test_a_reload_while_it_is_imported_does_not_begin_it_twice(run: Callable[..., Rig]) -> None:
    async def scenario(rig: Rig) -> None:
        rig.is_slow = True
        rig.reload("second")
        await asyncio.sleep(0.2)
        rig.reload("third")
        await asyncio.sleep(3.0)

    assert run(scenario, "off").log == [("begun", "third"), "ended"]


def test_what_did_not_fit_is_declared(run: Callable[..., Rig]) -> None:
    async def scenario(rig: Rig) -> None:
        for _ in range(MOST + 3):
            rig.runner.put(RECORD)

    rig = run(scenario)
    assert rig.log.count(RECORD) == MOST
    assert rig.events == [((EventCode.PLUGIN_BEHIND,), {"plugin": "sample", "records": 3})]


def test_of_a_value_the_newest_waits_and_everything_else_comes_in_order() -> None:
    queue = PluginQueue()
    for record in (value(1), RECORD, value(2, "torque"), RECORD, value(3)):
        queue.put(record)

    taken = [queue.take() for _ in range(5)]

    assert taken == [RECORD, value(2, "torque"), RECORD, value(3), None]
