"""The page beside everything else: begun late, switched by a reload, alone with its faults."""

from __future__ import annotations

import asyncio
import importlib
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest

from gateway.app.integrations.integration import POLLING_WITHIN_S, IntegrationHost, IntegrationService, Load
from gateway.app.page.access import WebAccess
from gateway.app.page.page import NOT_INSTALLED, open_pages, page_integration, web_settings_of
from gateway.app.site import Site
from gateway.mqtt.contract.payloads import Message
from gateway.records import Record, Severity
from tests.config.sites import site
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock

WEB = ('[[operator]]\nclient = "alice"', '[web]\n[[operator]]\nclient = "alice"')


class FakeService:
    """A page that records what it is fed; made anew each time."""

    made: ClassVar[list[FakeService]] = []

    def __init__(self, settings: Any, site: Any, access: Any, clock: Any, **_: object) -> None:
        self.settings, self.fed, self.moves = settings, [], 0
        self.is_broken = False
        FakeService.made.append(self)

    async def run(self) -> None:
        await asyncio.Event().wait()

    def put(self, record: Record) -> None:
        if self.is_broken:
            raise ZeroDivisionError
        self.fed.append(record)

    def publish(self, topic: str, payload: bytes, **_: object) -> None:
        self.put(topic)  # type: ignore[arg-type]

    def move(self, settings: Any, site: Any) -> None:
        self.moves += 1


class FakePublisher:
    def __init__(self) -> None:
        self.on_message: Callable[[Message], None] | None = None

    def listen(self, on_message: Callable[[Message], None] | None) -> None:
        self.on_message = on_message
        if on_message:
            on_message(Message("starters/mcc1/gateway/status", b"{}", qos=1, retain=True))


async def _here(load: Load) -> Callable[[Site], IntegrationService]:
    return load()


class PageStage:
    """The page's integration with everything around it faked."""

    def __init__(self, *changes: tuple[str, str]) -> None:
        FakeService.made = []
        self.publisher, self.events = FakePublisher(), []
        self.is_polling = True
        self.page = page_integration(
            IntegrationHost(
                self.site(*changes),
                VirtualClock(asyncio.get_running_loop()),
                lambda: self.is_polling,
                lambda code, severity, text, data=None, /: self.events.append((code, severity, text)),
                in_thread=_here,
            ),
            types.SimpleNamespace(),  # type: ignore[arg-type]
            publisher=self.publisher,  # type: ignore[arg-type]
        )

    @staticmethod
    def site(*changes: tuple[str, str]) -> Site:
        return Site(site(*changes), Path("/etc"), None, ())

    @property
    def services(self) -> list[FakeService]:
        return FakeService.made


@pytest.fixture
def imports(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let the page's modules be a fake one; return what was imported."""
    imported: list[str] = []

    def load(name: str) -> object:
        imported.append(name)
        return types.SimpleNamespace(WebService=FakeService)

    monkeypatch.setattr(importlib, "import_module", load)
    return imported


@virtually
async def _until_polled(imports: list[str]) -> None:
    stage = PageStage(WEB)
    stage.is_polling = False
    running = asyncio.create_task(stage.page.run())
    await asyncio.sleep(POLLING_WITHIN_S / 2)
    assert imports == []
    stage.is_polling = True
    await asyncio.sleep(0.5)
    assert imports == ["gateway.web.service"]
    assert stage.services[0].fed == ["starters/mcc1/gateway/status"]
    running.cancel()


def test_nothing_of_a_web_server_is_imported_until_the_lines_poll(imports: list[str]) -> None:
    _until_polled(imports)


def test_the_gateway_itself_imports_no_web_server() -> None:
    code = "import sys, gateway.cli.run; print({'starlette', 'uvicorn', 'h11'} & set(sys.modules))"

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout.strip() == "set()"


@virtually
async def _broken(*, is_message: bool) -> None:
    stage = PageStage(WEB)
    running = asyncio.create_task(stage.page.run())
    await asyncio.sleep(1.0)
    stage.services[0].is_broken = True

    if is_message:
        assert stage.publisher.on_message is not None
        for _ in range(2):
            stage.publisher.on_message(Message("x", b"{}", qos=1, retain=True))  # does not raise
    else:
        stage.page.put("a record")  # type: ignore[arg-type]  # does not raise
        stage.page.put("another")  # type: ignore[arg-type]
    await asyncio.sleep(0.1)
    assert stage.publisher.on_message is None
    assert open_pages(stage.page) is None

    await asyncio.sleep(2.0)
    stage.page.put("a record")  # type: ignore[arg-type]
    assert stage.services[1].fed[-1] == "a record"
    assert not running.done()
    running.cancel()


@pytest.mark.usefixtures("imports")
@pytest.mark.parametrize("is_message", [False, True])
def test_a_bug_in_what_the_page_takes_ends_the_page_alone_and_it_begins_anew(
    caplog: pytest.LogCaptureFixture, *, is_message: bool
) -> None:
    _broken(is_message=is_message)

    assert [record.levelname for record in caplog.records] == ["ERROR"]


@virtually
async def _missing() -> None:
    stage = PageStage(WEB)
    running = asyncio.create_task(stage.page.run())
    await asyncio.sleep(60.0)
    assert stage.events == [("web_away", Severity.ERROR, NOT_INSTALLED)]
    stage.page.move(stage.site(WEB))  # installed meanwhile, or not: tried again
    await asyncio.sleep(1.0)
    assert len(stage.events) == 2
    running.cancel()


def test_missing_packages_are_an_event_and_nothing_else(
    imports: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(name: str) -> object:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", fail)

    _missing()


def test_settings_are_plain_values_with_paths_below_the_configurations_folder() -> None:
    config = site((WEB[0], '[web]\ncert_file = "c.pem"\nkey_file = "/k.pem"\nbase_path = "/x"\n' + WEB[0]))
    assert config.web is not None

    settings = web_settings_of(config.web, Path("/etc/gw"))

    assert (settings.cert_file, settings.key_file) == ("/etc/gw/c.pem", "/k.pem")
    assert settings.url == "https://127.0.0.1:8480/x/"
    assert settings.is_tls


def test_what_the_page_needs_of_the_gateway_is_all_there() -> None:
    from gateway.web.interface import GatewayAccess

    wanted = {name for name in vars(GatewayAccess) if not name.startswith("_")}
    assert wanted <= set(dir(WebAccess))
