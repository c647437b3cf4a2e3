"""The page beside everything else: alone with its faults, and nothing of it where it is not wanted."""

from __future__ import annotations

import asyncio
import errno
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gateway.plugins.web.page import Page
from gateway.plugins.web.plugin import settings_of
from tests.config.sites import site
from tests.web.support import FakeGateway, HandClock, web_settings

TABLE = '[[operator]]\nclient = "alice"'


def test_the_gateway_itself_imports_neither_web_server_nor_prometheus() -> None:
    unwanted = {"starlette", "uvicorn", "h11", "prometheus_client"}
    code = f"import sys, gateway.cli.run; print({unwanted} & set(sys.modules))"

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout.strip() == "set()"


async def test_an_address_that_stays_in_use_is_one_event(monkeypatch: pytest.MonkeyPatch) -> None:
    class Taken:
        def __init__(self, *_: object) -> None:
            self.is_open = asyncio.Event()
            tries.append(self)
            if len(tries) == 3:
                enough.set()

        async def run(self) -> None:
            raise OSError(errno.EADDRINUSE, "Address already in use")

    tries: list[Taken] = []
    enough = asyncio.Event()
    monkeypatch.setattr("gateway.plugins.web.page.RETRY_S", 0.0)
    gateway = FakeGateway(HandClock(), make_web_server=Taken)
    task = asyncio.create_task(Page(cast("Any", gateway), web_settings()).run())

    await enough.wait()
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)

    assert gateway.events == ["web_away"]


def test_settings_are_plain_values_with_paths_below_the_configurations_folder() -> None:
    config = site((TABLE, f'[web]\ncert_file = "c.pem"\nkey_file = "/k.pem"\nbase_path = "/x"\n{TABLE}'))
    read: Any = SimpleNamespace(config=config, folder=Path("/etc/gw"), path=None, computed={})

    settings = settings_of(read)

    assert settings is not None
    assert (settings.cert_file, settings.key_file) == ("/etc/gw/c.pem", "/k.pem")
    assert settings.url == "https://127.0.0.1:8480/x/"
    assert settings.is_tls
