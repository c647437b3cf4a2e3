"""A plant with a status page, and a real Chromium that looks at it."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.async_api import Page, async_playwright, expect

from gateway.system.password_hash import password_line
from tests.end_to_end.plant import STARTERS, plant
from tests.end_to_end.site import FOUR_FAMILIES, Program, Scada
from tests.mosquitto import MosquittoBroker, free_port
from tests.rig.sites import table

HOLD = ".hold-box:not([hidden]) button.hold"
USER, PASSWORD = "anna", "correct horse"
PATIENCE_MS = 20_000.0
expect.set_options(timeout=PATIENCE_MS)

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@dataclass
class PagePlant:
    """What a test of the page has at hand."""

    url: str
    scada: Scada
    gateway: Program
    config: Path
    port: int


PumpPage = tuple[PagePlant, Page]


@asynccontextmanager
async def page_plant(
    broker: MosquittoBroker,
    folder: Path,
    *,
    starters: str = FOUR_FAMILIES,
    names: tuple[str, ...] = STARTERS,
    base_path: str = "/",
) -> AsyncIterator[PagePlant]:
    """Run simulator and gateway with a page below a path, and wait until all starters are ready."""
    port = free_port()
    user = table("[web.user]", name=USER, password=password_line(PASSWORD), operator="alice")
    more = table("web", listen=f"127.0.0.1:{port}", base_path=base_path) + user
    async with plant(broker, folder, starters=starters, names=names, more=more) as (scada, gateway, config):
        await gateway.says("the status page is served")
        yield PagePlant(f"http://127.0.0.1:{port}{base_path}", scada, gateway, config, port)


@dataclass
class Browser:
    """One browser, its pages' complaints, and how a person uses it."""

    chromium: Any
    complaints: list[str] = field(default_factory=list)

    async def open(self, url: str, **options: Any) -> Page:
        """Return a page on an address, in a session of its own; `options` are Chromium's (viewport ..)."""
        context = await self.chromium.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
        page: Page = await context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", lambda said: said.type == "error" and self.complaints.append(said.text))
        await page.goto(url)
        return page


Site = tuple[PagePlant, Browser]


@asynccontextmanager
async def browser() -> AsyncIterator[Browser]:
    """Start Chromium; at its end no page may have had an error of its script or of the content policy."""
    async with async_playwright() as playwright:
        chromium = await playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        try:
            opened = Browser(chromium)
            yield opened
            expected = ("Failed to load resource", "net::ERR")  # refused logins, servers that stand still
            assert [each for each in opened.complaints if not each.startswith(expected)] == [], (
                opened.complaints
            )
        finally:
            await chromium.close()


async def logged_in(page: Page, password: str = PASSWORD, user: str = USER) -> None:
    await page.click("#account")
    await page.fill("input[name=user]", user)
    await page.fill("input[name=password]", password)
    await page.click("#login-form button[type=submit]")
    await page.get_by_role("button", name=f"{user}: log out").wait_for()


async def select_start(page: Page) -> tuple[float, float]:
    """Select a start and return where the button to hold stands."""
    await page.locator("button[data-action^='start ']:enabled").click()
    box = await page.locator(HOLD).bounding_box()
    assert box is not None
    return box["x"] + 20, box["y"] + 20


async def hold_to_start(page: Page) -> None:
    """Select a start and hold the button that appears until it is carried out."""
    await page.mouse.move(*await select_start(page))
    await page.mouse.down()
    await page.locator(".hold-box").wait_for(state="hidden")
    await page.mouse.up()


async def hold_for(page: Page, hold_ms: int) -> None:
    """Hold the button of a selected start for so long by the page's own clock."""
    await page.locator(HOLD).evaluate(
        "(button) => { const at = (name) => button.dispatchEvent(new PointerEvent(name, {button: 0}));"
        f" at('pointerdown'); setTimeout(() => at('pointerup'), {hold_ms}); }}"
    )
