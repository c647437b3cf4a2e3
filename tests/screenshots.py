"""Takes the pictures of the status page for the documents: `python -m tests.screenshots [--minutes 13]`.

It runs the demo's plant until it has a history, then looks at it with Chromium. The trip of the day is
waited for, so that the overview shows something abnormal. With --report it draws the health report of a
simulated year, and nothing else.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import struct
import sys
import tempfile
import zlib
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

from playwright.async_api import Browser, Page, async_playwright, expect

from gateway.cli.report.html import to_html
from tests.end_to_end.page.support import CHROMIUM, logged_in
from tests.end_to_end.site import Program
from tests.history.year import lived, report_of
from tests.history.year import write as write_year

FOLDER = Path(__file__).parent.parent / "docs" / "pictures"
MOST_BYTES = 250_000
MINUTES = 13.0  # then the sparklines' ten minutes are full
TRIP_WITHIN_S = 180.0  # the plant's day has two minutes
DESK = {"viewport": {"width": 1280, "height": 800}}
PHONE = {"viewport": {"width": 360, "height": 740}, "device_scale_factor": 2}


class Picture(NamedTuple):
    """One picture: its file, the page's view, and how the browser shows it."""

    name: str
    view: str
    options: dict[str, Any]


PICTURES = (
    Picture("page-overview", "#/", DESK),
    Picture("page-dark", "#/", {**DESK, "color_scheme": "dark"}),
    Picture("page-phone", "#/starter/mill", PHONE),
    Picture("page-events", "#/events", DESK),
    Picture("page-starter", "#/starter/pump", {"viewport": {"width": 1280, "height": 1000}}),
    Picture("page-lines", "#/lines", DESK),
    Picture("page-gateway", "#/gateway", DESK),
    Picture("page-wall", "#/wall", {"viewport": {"width": 1920, "height": 1080}}),
)


async def draw_report() -> None:
    """Write the picture of a health report."""
    with tempfile.TemporaryDirectory() as name:
        path = await write_year(Path(name), await lived())
        text = to_html(report_of(path), language="en")
    async with async_playwright() as playwright:
        chromium = await playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = await chromium.new_page(viewport={"width": 760, "height": 1930})
        await page.set_content(text)
        write(FOLDER / "report.png", await page.screenshot())
        await chromium.close()


async def take(minutes: float) -> None:
    """Run the plant, take the pictures, and write them."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    async with (
        Program("gateway", "demo", "--plant", environ={"TMPDIR": "/tmp"}) as demo,
        async_playwright() as playwright,
    ):
        await demo.says("the status page is served")
        found = re.search(r"http://127\.0\.0\.1:\d+/", demo.output)
        assert found is not None
        await asyncio.sleep(minutes * 60)
        chromium = await playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        async with visitor(chromium, found[0], DESK) as page:
            await expect(page.locator(".counter.fault .count")).to_have_text(
                "1", timeout=TRIP_WITHIN_S * 1000
            )
        for picture in PICTURES:
            async with visitor(chromium, found[0], picture.options, view=picture.view) as page:
                write(FOLDER / f"{picture.name}.png", await page.screenshot())
        await chromium.close()


@asynccontextmanager
async def visitor(
    chromium: Browser, url: str, options: dict[str, Any], *, view: str = "#/"
) -> AsyncIterator[Page]:
    """Open a page, log in, go to a view, and wait until it shows what it loads."""
    context = await chromium.new_context(**options)
    page = await context.new_page()
    await page.goto(url)
    await logged_in(page, password="demo", user="demo")
    await page.goto(url + view)
    await page.wait_for_timeout(1000.0)
    yield page
    await context.close()


def write(path: Path, png: bytes) -> None:
    """Write a picture as small as it gets; ValueError when it is too large for a document."""
    small = squeezed(png)
    if len(small) > MOST_BYTES:
        raise ValueError(f"{path.name} has {len(small)} bytes, more than {MOST_BYTES}")
    path.write_bytes(small)
    sys.stdout.write(f"{path.name}: {len(small)} bytes\n")


def squeezed(png: bytes) -> bytes:
    """Return a PNG with one image chunk compressed as far as zlib goes, and nothing that is not seen."""
    at, chunks, pixels = 8, [], b""
    while at < len(png):
        (size,) = struct.unpack(">I", png[at : at + 4])
        kind, content = png[at + 4 : at + 8], png[at + 8 : at + 8 + size]
        if kind == b"IDAT":
            pixels += content
        elif kind in (b"IHDR", b"PLTE", b"tRNS"):
            chunks.append((kind, content))
        at += size + 12
    chunks.append((b"IDAT", zlib.compress(zlib.decompress(pixels), 9)))
    return min(png, png_of(chunks), key=len)


def png_of(chunks: Iterable[tuple[bytes, bytes]]) -> bytes:
    """Return a PNG of these chunks: kind and content, all but the last, which has none."""
    parts = [
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        for kind, content in (*chunks, (b"IEND", b""))
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def main() -> None:
    """Take all pictures."""
    parser = argparse.ArgumentParser(prog="python -m tests.screenshots", description=__doc__)
    parser.add_argument("--minutes", type=float, default=MINUTES, help="how long the plant runs before")
    parser.add_argument("--report", action="store_true", help="only the health report")
    args = parser.parse_args()
    asyncio.run(draw_report() if args.report else take(args.minutes))


if __name__ == "__main__":
    main()
