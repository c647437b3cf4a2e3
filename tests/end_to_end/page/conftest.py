"""What tests of the page have: Chromium beside a plant; a page at the pump, where somebody is logged in."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.end_to_end.page.support import CHROMIUM, PumpPage, Site, browser, logged_in, page_plant
from tests.mosquitto import StartMosquitto
from tests.programs import without


@pytest.fixture(autouse=True)
def _installed() -> None:
    if CHROMIUM is None:
        without("chromium", "chromium")


@pytest.fixture
async def pump(start_mosquitto: StartMosquitto, tmp_path: Path) -> AsyncIterator[PumpPage]:
    """Give a plant and the page of its pump, which is served below a path, as behind a proxy."""
    async with page_plant(start_mosquitto(), tmp_path, base_path="/mcc1/") as plant, browser() as chromium:
        page = await chromium.open(f"{plant.url}#/starter/pump")
        await logged_in(page)
        yield plant, page


@pytest.fixture
async def site(start_mosquitto: StartMosquitto, tmp_path: Path) -> AsyncIterator[Site]:
    """Give a plant and a browser that shows nothing yet."""
    async with page_plant(start_mosquitto(), tmp_path) as plant, browser() as chromium:
        yield plant, chromium
