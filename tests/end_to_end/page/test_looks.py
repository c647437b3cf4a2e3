"""How the page looks: on a phone, in the dark, to a screen reader, with 247 starters."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.base import AXE_FILE_PATH
from playwright.async_api import Page, expect

from tests.end_to_end.page.support import Site, browser, logged_in, page_plant
from tests.mosquitto import StartMosquitto
from tests.rig.sites import ALICE, starter

pytestmark = [pytest.mark.long]

AXE = Path(AXE_FILE_PATH).read_text("utf-8")
PAGES = ("", "#/starter/pump", "#/starter/mill", "#/lines", "#/events", "#/gateway", "#/wall")
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]


async def findings(page: Page) -> list[str]:
    """Return what axe-core finds against WCAG 2.2 AA."""
    await page.evaluate(AXE)
    options = json.dumps({"runOnly": {"type": "tag", "values": RULES}})
    found: dict[str, Any] = await page.evaluate(f"axe.run(document, {options})")
    return [
        f"{each['id']}: {node['html'][:200]} {node['failureSummary']}"
        for each in found["violations"]
        for node in each["nodes"]
    ]


async def test_axe_finds_nothing_on_any_page(site: Site) -> None:
    plant, chromium = site
    plant.scada.set_knob("mill", "trip", "F005")
    plant.scada.set_knob("fan", "control", "local")
    await plant.scada.until("starter/mill/state", state="fault")
    for scheme in ("light", "dark"):
        page = await chromium.open(plant.url, color_scheme=scheme)
        await logged_in(page)
        for address in PAGES:
            await page.goto(plant.url + address)
            await page.wait_for_timeout(1500.0)
            assert await findings(page) == [], (scheme, address)
        await page.context.close()


async def test_a_phone_shows_everything_without_scrolling_sideways_and_with_targets_for_a_glove(
    site: Site,
) -> None:
    plant, chromium = site
    page = await chromium.open(plant.url, viewport={"width": 360, "height": 740}, has_touch=True)
    await logged_in(page)
    for address in PAGES:
        await page.goto(plant.url + address)
        await page.wait_for_timeout(1000.0)
        assert await page.evaluate("document.documentElement.scrollWidth") <= 360, address
        sizes = await page.evaluate(
            "[...document.querySelectorAll('button, input, select, nav a, li a')]"
            ".filter((e) => e.offsetParent && !e.closest('dialog'))"
            ".map((e) => [e.outerHTML.slice(0, 80), e.getBoundingClientRect().height])"
        )
        assert [each for each in sizes if each[1] < 44] == [], address
    await page.goto(f"{plant.url}#/starter/pump")
    stop = await page.locator("button.stop").bounding_box()
    assert stop is not None
    assert stop["y"] + stop["height"] <= 740  # without scrolling


def many(count: int) -> str:
    starters = (starter(f"m{place}", place, "ssw07", enabled=place < 3) for place in range(1, count + 1))
    return "".join(starters) + ALICE


async def test_247_starters_are_no_trouble(start_mosquitto: StartMosquitto, tmp_path: Path) -> None:
    # The listener is slower than 9000 messages a second, and Mosquitto drops what waits beyond 1000.
    broker = start_mosquitto(options=["max_queued_messages 100000"])
    plan = page_plant(broker, tmp_path, starters=many(247), names=("m1", "m2"))
    async with plan as plant, browser() as chromium:
        page = await chromium.open(plant.url)
        await expect(page.locator("li[data-starter]")).to_have_count(247)
        took_ms = await page.evaluate(
            "(() => { const begun = performance.now();"
            " const box = document.querySelector('input[type=search]');"
            " box.value = 'm2'; box.dispatchEvent(new Event('input')); document.body.offsetHeight;"
            " return performance.now() - begun; })()"
        )
        assert took_ms < 500.0
        await page.locator("li[data-starter=m2]").click()
        await expect(page.locator("main h1")).to_have_text("m2")
