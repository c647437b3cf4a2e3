"""Nothing on the page starts a motor that its operator did not mean, and STOP always tries."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import pytest
from playwright.async_api import Page, Route, expect

from tests.end_to_end.page.support import (
    HOLD,
    PagePlant,
    PumpPage,
    Site,
    browser,
    hold_for,
    logged_in,
    page_plant,
    select_start,
)
from tests.mosquitto import StartMosquitto
from tests.relay import Relay
from tests.waiting import until

pytestmark = [pytest.mark.long]

NOT_LIVE_MS = 14_000.0  # 12 s, and the next look
# Timers that come every ten seconds or later come twenty times as often.
QUICK_TIMERS = (
    "const slow = setInterval; window.setInterval = (f, ms) => slow(f, ms >= 10000 ? ms / 20 : ms);"
)


async def nothing_started(page: Page, plant: PagePlant, deed: str) -> None:
    """Wait for what may be on its way, and see that no start was given."""
    await page.wait_for_timeout(1500.0)
    await expect(page.locator(".big-state")).to_have_text("ready")
    await plant.scada.command("pump", "read", f"after {deed}", parameter="P003")
    await plant.scada.result("pump", id=f"after {deed}", phase="confirmed")
    assert not any(each["verb"] == "start" for each in plant.scada.results), deed


async def browser_processes(page: Page) -> list[int]:
    """Return the processes of the page's Chromium."""
    assert page.context.browser is not None
    session = await page.context.browser.new_browser_cdp_session()
    return [each["id"] for each in (await session.send("SystemInfo.getProcessInfo"))["processInfo"]]


def signalled(processes: list[int], number: signal.Signals) -> None:
    for each in processes:
        with suppress(ProcessLookupError):  # some end by themselves
            os.kill(each, number)


async def hold_then_sleep(page: Page, x: float, y: float) -> None:
    """Hold the button, and let the browser stand still meanwhile, as a laptop whose lid is shut."""
    processes = await browser_processes(page)
    await page.mouse.move(x, y)
    await page.mouse.down()
    signalled(processes, signal.SIGSTOP)
    await asyncio.sleep(4.0)
    signalled(processes, signal.SIGCONT)


async def hold_nearly_a_second(page: Page, *_: float) -> None:
    await hold_for(page, 930)


async def slide_off(page: Page, x: float, y: float) -> None:
    """Touch the button and let the finger slide off it."""
    session = await page.context.new_cdp_session(page)
    touch = {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
    away = {"type": "touchMove", "touchPoints": [{"x": x, "y": y - 250}]}
    await asyncio.gather(*(session.send("Input.dispatchTouchEvent", each) for each in (touch, away)))
    await page.wait_for_timeout(1500.0)


async def double_tap(page: Page, x: float, y: float) -> None:
    for _ in range(6):
        await page.touchscreen.tap(x, y)


async def press_keys_again_and_again(page: Page, *_: float) -> None:
    await page.locator(HOLD).focus()
    for _ in range(15):
        await page.keyboard.press("Enter", delay=100.0)


async def switch_windows(page: Page, x: float, y: float) -> None:
    await page.locator(HOLD).evaluate(
        "(button) => button.addEventListener('pointerdown',"
        " () => setTimeout(() => window.dispatchEvent(new Event('blur')), 300))"
    )
    await page.mouse.move(x, y)
    await page.mouse.down()
    await page.wait_for_timeout(1600.0)


DEEDS: tuple[Callable[..., Awaitable[None]], ...] = (
    hold_then_sleep,
    hold_nearly_a_second,
    slide_off,
    double_tap,
    press_keys_again_and_again,
    switch_windows,
)


async def test_what_is_no_second_of_holding_starts_nothing(site: Site) -> None:
    plant, chromium = site
    for deed in DEEDS:
        page = await chromium.open(f"{plant.url}#/starter/pump", has_touch=True)
        await logged_in(page)
        await deed(page, *await select_start(page))
        await nothing_started(page, plant, deed.__name__)
        await page.context.close()


async def test_a_selection_that_is_answered_late_is_given_up(pump: PumpPage) -> None:
    plant, page = pump

    async def late(route: Route) -> None:
        answer = await route.fetch()
        await asyncio.sleep(7.0)
        await route.fulfill(response=answer)

    await page.route("**/select", late)
    await page.locator("button[data-action^='start ']:enabled").click()
    await plant.scada.result("pump", verb="select", phase="confirmed")
    await plant.scada.result("pump", verb="cancel", phase="confirmed")

    await expect(page.locator(".hold-box")).to_be_hidden()


async def test_when_the_network_is_cut_the_page_says_so_and_a_stop_leaves_the_browser_at_once(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with (
        page_plant(start_mosquitto(), tmp_path) as plant,
        Relay(plant.port) as relay,
        browser() as chromium,
    ):
        page = await chromium.open(f"http://127.0.0.1:{relay.port}/#/starter/pump")
        await page.add_init_script(QUICK_TIMERS)
        await page.reload()
        await logged_in(page)
        relay.stall()
        await page.evaluate("const now = Date.now; Date.now = () => now() - 3600000; 0")  # makes nothing live
        await expect(page.locator("#veil")).to_contain_text("NOT LIVE", timeout=NOT_LIVE_MS)

        await expect(page.locator("button[data-action^='start ']")).to_be_disabled()
        await page.click("button.stop")
        await expect(page.locator(".toast").last).to_contain_text("sent")
        await until(lambda: b"POST /api/v1/command/pump/stop" in relay.received)
        await expect(page.locator(".toast").last).to_contain_text(
            "not known whether it arrived", timeout=4000.0
        )

        await relay.join()
        await expect(page.locator("#veil")).to_be_hidden()
        await plant.scada.result("pump", verb="stop", phase="confirmed")


async def test_stop_stands_at_the_same_place_whatever_else_the_page_shows(site: Site) -> None:
    places: dict[int, list[list[float]]] = {}  # by the width of the page
    plant, chromium = site
    pages = {}
    for width in (360, 768, 1280, 1920):
        size = {"width": width, "height": 740}
        pages[width] = page = await chromium.open(f"{plant.url}#/starter/pump", viewport=size)
        await logged_in(page)
        places[width] = [await stop_place(page)]
        for _ in range(5):
            await page.click("button.stop")
        await expect(page.locator(".toast")).to_have_count(5)
        places[width].append(await stop_place(page))
        await page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
        places[width].append(await stop_place(page))
    plant.gateway.signal(signal.SIGSTOP)
    for width, page in pages.items():
        await expect(page.locator("#veil")).to_be_visible()
        places[width].append(await stop_place(page))
    plant.gateway.signal(signal.SIGCONT)

    assert places == {width: [seen[0]] * 4 for width, seen in places.items()}


async def stop_place(page: Page) -> list[float]:
    """Return where STOP stands, and that nothing covers it."""
    found = await page.locator("button.stop").evaluate(
        "(stop) => { const { x, y, width, height } = stop.getBoundingClientRect();"
        " const top = document.elementFromPoint(x + width / 2, y + height / 2);"
        " return [x, y, width, height, Number(stop.contains(top))]; }"
    )
    assert found[4] == 1, "something covers STOP"
    return [float(each) for each in found]


async def test_a_starter_that_a_reload_removes_shows_nothing_old_and_takes_no_command(pump: PumpPage) -> None:
    plant, page = pump
    await expect(page.locator("button[data-action^='start ']:enabled")).to_have_count(1)
    text = plant.config.read_text("utf-8")
    without = text.replace(
        text[text.index("[[line.starter]]") : text.index('name = "fan"')], "[[line.starter]]\n"
    )
    plant.config.write_text(without, "utf-8")
    plant.gateway.signal(signal.SIGHUP)

    await expect(page.locator(".trouble").first).to_contain_text("no starter pump")
    await expect(page.locator("button[data-action^='start ']:enabled")).to_have_count(0)
    await expect(page.locator(".big-state")).to_have_text("")
    await expect(page.locator(".big-current")).to_have_text("")
