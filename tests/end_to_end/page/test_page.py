"""What a person sees of the page, and does with it."""

from __future__ import annotations

import re

import pytest
from playwright.async_api import expect

from tests.end_to_end.page.support import (
    STARTERS,
    PumpPage,
    Site,
    hold_to_start,
    logged_in,
    select_start,
)

pytestmark = [pytest.mark.long]


async def test_all_starters_are_shown_to_everyone_and_follow_within_a_second(site: Site) -> None:
    plant, chromium = site
    page = await chromium.open(plant.url)
    await expect(page.locator("#live")).to_have_text("LIVE")
    for starter in STARTERS:
        await expect(page.locator(f"li[data-starter={starter}] .state")).to_have_text("ready")

    await plant.scada.command("pump", "start", "one")
    await plant.scada.until("starter/pump/state", state="starting")
    await expect(page.locator("li[data-starter=pump] .state")).to_have_text("starting", timeout=1000.0)

    await plant.scada.command("fan", "general_enable", "two", value=False)
    await expect(page.locator("li[data-starter=fan] .trouble")).to_contain_text("not enabled")

    plant.scada.set_knob("mill", "trip", "F005")
    await plant.scada.until("starter/mill/state", state="fault")
    await expect(page.locator("li[data-starter=mill] .state")).to_have_text("fault", timeout=1000.0)
    await expect(page.locator("li[data-starter]").first).to_have_attribute("data-starter", "mill")
    await expect(page.locator(".counter.fault .count")).to_have_text("1")
    await page.locator(".counter.fault").click()
    await expect(page.locator("li[data-starter]")).to_have_count(1)
    await page.locator(".counter.fault").click()
    await page.fill("input[type=search]", "fan")
    await expect(page.locator("li[data-starter]")).to_have_count(1)


async def test_a_start_is_selected_and_held_and_a_stop_is_one_click(pump: PumpPage) -> None:
    plant, page = pump
    await select_start(page)
    await page.get_by_role("button", name="Cancel").click()
    await expect(page.locator(".hold-box")).to_be_hidden()

    await hold_to_start(page)
    await plant.scada.result("pump", verb="start", phase="confirmed")
    await expect(page.locator(".big-state")).to_have_text(re.compile("starting|running"))
    await expect(page.locator(".toast.good").last).to_contain_text("accepted → written → confirmed")

    await page.click("button.stop")
    stopped = await plant.scada.result("pump", verb="stop", phase="confirmed")
    await expect(page.locator(".toast.good").last).to_contain_text("stop pump")

    starts = [each for each in plant.scada.results if each["verb"] == "start" and each["phase"] == "written"]
    assert len(starts) == 1
    assert stopped["code"] == "ok"


async def test_a_selected_start_falls_when_the_state_changes_before_it_is_held(pump: PumpPage) -> None:
    plant, page = pump
    await page.locator("button[data-action^='start ']:enabled").click()
    await page.locator(".hold-box:not([hidden])").wait_for()

    plant.scada.set_knob("pump", "trip", "E05")

    await page.locator(".hold-box").wait_for(state="hidden")
    await expect(page.locator(".big-state")).to_have_text("fault")
    await expect(page.locator("button[data-action^='start ']")).to_be_disabled()
    assert not any(each["verb"] == "start" for each in plant.scada.results)


async def test_the_keyboard_alone_is_enough(site: Site) -> None:
    plant, chromium = site
    page = await chromium.open(plant.url)
    await page.locator("li[data-starter=pump] a").focus()
    await page.keyboard.press("Enter")
    await page.locator("#account").focus()
    await page.keyboard.press("Enter")
    await page.keyboard.type("anna")
    await page.keyboard.press("Tab")
    await page.keyboard.type("correct horse")
    await page.keyboard.press("Enter")
    await page.locator("button[data-action^='start ']:enabled").focus()
    await page.keyboard.press("Enter")
    await expect(page.locator("button.hold")).to_be_focused()

    await page.keyboard.down(" ")
    await page.locator(".hold-box").wait_for(state="hidden")
    await page.keyboard.up(" ")
    await plant.scada.result("pump", verb="start", phase="confirmed")
    await page.locator("button.stop").focus()
    await page.keyboard.press("Enter")
    await plant.scada.result("pump", verb="stop", phase="confirmed")


async def test_foreign_words_are_shown_as_text_and_run_nothing(site: Site) -> None:
    plant, chromium = site
    page = await chromium.open(f"{plant.url}#/starter/%3Cscript%3E")
    await expect(page.locator("main h1")).to_have_text("<script>")
    await expect(page.locator("main")).to_contain_text("no starter <script>")

    token = await plant.scada.token()
    evil = "<img src=x onerror=window.evil=1>"
    lock = {"id": "l", "token": token, "reason": evil, "operator": evil}
    plant.scada.say("command/pump/alice/lock", lock)
    await plant.scada.result("pump", id="l", phase="confirmed")
    await page.goto(f"{plant.url}#/events")
    await page.reload()
    await expect(page.locator("main")).to_contain_text("lock")
    await page.goto(f"{plant.url}#/starter/pump")
    await expect(page.locator(".trouble").first).to_contain_text("locked by alice")

    assert await page.evaluate("window.evil") is None
    assert await page.locator("main img, main script").count() == 0


async def test_the_pages_of_lines_events_and_the_gateway_show_what_is_published(site: Site) -> None:
    plant, chromium = site
    page = await chromium.open(f"{plant.url}#/lines")
    await expect(page.get_by_role("table", name="Starters on hall")).to_contain_text("pump", timeout=45_000.0)
    await expect(page.get_by_role("table", name="Promised and measured")).to_contain_text("a stop waits")
    await page.get_by_role("link", name="Events").click()
    plant.scada.set_knob("belt", "power", "off")
    await expect(page.locator("main")).to_contain_text("belt", timeout=30_000.0)
    await page.get_by_role("link", name="Gateway").click()
    await expect(page.get_by_role("table", name="This gateway")).to_contain_text("not a safety function")
    await logged_in(page)
    await page.get_by_role("button", name="Run check").click()
    await expect(page.locator("pre").first).to_contain_text("exit code 0", timeout=60_000.0)


async def test_parameters_are_read_and_set_with_the_old_value_beside(pump: PumpPage) -> None:
    plant, page = pump
    await page.locator("details.parameters > summary").click()
    await page.get_by_label("Search parameters").fill("P314")
    await page.get_by_role("button", name="Set P314").click()
    await expect(page.locator(".set-form")).to_contain_text("now ")
    await page.get_by_label("New value of P314").fill("30")
    await page.locator(".set-form button[type=submit]").click()
    await plant.scada.result("pump", verb="set", phase="confirmed")
    await expect(page.locator("details.parameters table")).to_contain_text("30 s")
