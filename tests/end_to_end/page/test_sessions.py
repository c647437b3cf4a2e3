"""A login that ends by itself, and the browser's own buttons: a real Chromium, without a gateway."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from playwright.async_api import expect

from gateway.contract import StatusRecord
from gateway.plugins.web.accounts import IDLE_S
from gateway.plugins.web.static_files import read_files
from tests.end_to_end.page.support import browser, logged_in
from tests.end_to_end.web.served import served
from tests.web.support import PageRig

pytestmark = [pytest.mark.long]

STOP = {"verb": "stop", "args": {}, "permitted": True, "two_step": False, "code": "", "text": ""}
START = {**STOP, "verb": "start", "two_step": True}


@asynccontextmanager
async def paged() -> AsyncIterator[tuple[PageRig, str]]:
    """Serve the shipped page with two starters, and values that go on."""
    rig = PageRig(files=read_files())
    rig.control.offers = [START, STOP]
    rig.publish(StatusRecord(state="online", time_s=1.0, boot="b", since_s=1.0, reason=None, run="r"))
    for starter in ("pump-1", "pump-2"):
        rig.state(starter, "ready")
    async with served(rig) as (_, _, port):
        yield rig, f"http://127.0.0.1:{port}/"


async def test_a_session_that_was_not_used_for_too_long_ends_and_nothing_is_lost_in_silence() -> None:
    async with paged() as (rig, url), browser() as chromium:
        page = await chromium.open(f"{url}#/starter/pump-1")
        await logged_in(page, "right")
        await expect(page.locator("button[data-action^='start ']")).to_be_enabled()

        rig.clock.s += IDLE_S + 1.0
        await page.get_by_role("button", name="STOP").click()

        asked = page.locator(".toast", has_text="stop pump-1")
        await expect(asked).to_contain_text("not carried out: log in first")
        assert rig.control.commands == []
        notice = page.locator(".toast", has_text="anna was logged out")
        await expect(notice).to_contain_text("Log in again to operate")
        await expect(page.locator("#account")).to_have_text("Log in")
        await expect(page.locator("#live")).to_have_text("LIVE")
        await logged_in(page, "right")
        await expect(notice).to_have_count(0)


async def test_a_logout_in_another_tab_is_shown_here_and_ones_own_is_not() -> None:
    async with paged() as (_, url), browser() as chromium:
        here = await chromium.open(url)
        await logged_in(here, "right")
        there = await here.context.new_page()
        await there.goto(url)
        await expect(there.locator("#account")).to_have_text("anna: log out")

        await there.click("#account")

        await expect(here.locator(".toast", has_text="anna was logged out")).to_be_visible()
        await expect(there.locator("#account")).to_have_text("Log in")
        await expect(there.locator(".toast")).to_have_count(0)


async def test_back_and_forward_go_through_the_views_and_each_is_live() -> None:
    async with paged() as (rig, url), browser() as chromium:
        page = await chromium.open(url)
        await page.get_by_role("link", name="pump-2").first.click()
        heading = page.get_by_role("heading", level=1)
        await expect(heading).to_have_text("pump-2")
        await page.get_by_role("link", name="Events").click()
        await expect(page).to_have_title("Events – mcc1")
        await expect(page.locator(".stop-place")).to_have_count(0)

        await page.go_back()
        await expect(heading).to_have_text("pump-2")
        rig.state("pump-2", "running")
        await expect(page.locator(".big-state")).to_contain_text("running")
        await expect(page.get_by_role("button", name="STOP")).to_have_count(1)

        await page.go_back()
        await expect(page.locator(".stop-place")).to_have_count(0)
        rig.state("pump-1", "fault")
        await expect(page.get_by_role("link", name="pump-1").first).to_be_visible()
        await expect(page.locator("#main")).to_contain_text("fault")

        await page.go_forward()
        await expect(heading).to_have_text("pump-2")
        await page.go_forward()
        await expect(page).to_have_title("(1) Events – mcc1")
        await page.reload()
        await expect(page).to_have_title("(1) Events – mcc1")
        await expect(page.locator("#live")).to_have_text("LIVE")
