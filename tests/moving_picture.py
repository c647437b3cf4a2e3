"""Makes the README's moving picture of the demo, page and terminal: `python -m tests.moving_picture`.

The commands are carried out while they are filmed. The picture is an animated PNG: after the first frame only
the rectangle that changed is stored, in colours of six bits.
"""

from __future__ import annotations

import asyncio
import base64
import html
import re
import shlex
import struct
import sys
import zlib
from typing import Any

from playwright.async_api import Page, async_playwright

from tests.end_to_end.page.support import CHROMIUM
from tests.end_to_end.site import Program
from tests.screenshots import FOLDER, png_of, visitor

FILE = FOLDER / "demo.png"
MOST_BYTES = 1_000_000
WIDTH, PAGE_HEIGHT, TERMINAL_HEIGHT = 960, 470, 180
FRAME_S = 0.5
LAST_FRAME_S = 4.0
SEND, KNOB = "starter-gateway send demo.toml", "mosquitto_pub -t simulator"
SCENES = (  # what is typed, and for how long it is watched
    (f"{SEND} fan start --client demo", 5.0),
    (f"{KNOB}/belt/power -m off   # one starter is off: the others do not wait for it", 4.0),
    (f"{SEND} mill start --client demo", 4.0),
    (f"{KNOB}/pump/trip -m E05", 3.0),
    (f"{SEND} fan stop --client demo", 3.0),
)
STAGE = f"""
<body style="margin: 0; background: #14181d">
<img id="page" style="display: block; width: {WIDTH}px; height: {PAGE_HEIGHT}px">
<pre id="terminal" style="margin: 0; padding: 8px 12px; height: {TERMINAL_HEIGHT - 16}px; overflow: hidden;
color: #e6e6e6; font: 14px/18px 'DejaVu Sans Mono', monospace"></pre>
<canvas id="canvas" width="{WIDTH}" height="{PAGE_HEIGHT + TERMINAL_HEIGHT}" hidden></canvas>
"""
CHANGED = """
async (png) => {
  const image = new Image();
  image.src = "data:image/png;base64," + png;
  await image.decode();
  const canvas = document.getElementById("canvas"), width = canvas.width, height = canvas.height;
  const context = canvas.getContext("2d", {willReadFrequently: true});
  context.drawImage(image, 0, 0);
  const now = context.getImageData(0, 0, width, height).data, last = window.last;
  let left = width, top = height, right = -1, bottom = -1;
  for (let y = 0, i = 0; y < height; y++) for (let x = 0; x < width; x++, i += 4) {
    if (last && now[i] === last[i] && now[i + 1] === last[i + 1] && now[i + 2] === last[i + 2]) continue;
    left = Math.min(left, x), right = Math.max(right, x);
    top = Math.min(top, y), bottom = Math.max(bottom, y);
  }
  window.last = now;
  if (right < 0) return null;
  const rows = [];
  for (let y = top; y <= bottom; y++) {
    rows.push(0);  // a row of PNG begins with its filter: none
    for (let x = left; x <= right; x++) for (let c = 0; c < 3; c++) {
      const value = now[4 * (y * width + x) + c] & 0xfc;
      rows.push(value | value >> 6);
    }
  }
  let text = "";
  for (let i = 0; i < rows.length; i += 8192) text += String.fromCharCode(...rows.slice(i, i + 8192));
  return {left, top, width: right - left + 1, height: bottom - top + 1, pixels: btoa(text)};
}
"""


class Film:
    """Collects frames: a rectangle with its pixels, and for how long nothing else changed."""

    def __init__(self, stage: Page, page: Page) -> None:
        self._stage, self._page = stage, page
        self._frames: list[tuple[dict[str, Any], float]] = []
        self.terminal = ""

    async def watch(self, seconds: float) -> None:
        """Film page and terminal for some time."""
        time_s = asyncio.get_running_loop().time
        end_s = time_s() + seconds
        while (began_s := time_s()) < end_s:
            await self._frame()
            await asyncio.sleep(max(0.0, FRAME_S - (time_s() - began_s)))
            frame, shown_s = self._frames[-1]
            self._frames[-1] = (frame, shown_s + time_s() - began_s)

    def png(self) -> bytes:
        """Return the animated PNG, which begins again at its end."""
        frames = [*self._frames[:-1], (self._frames[-1][0], LAST_FRAME_S)]
        head = struct.pack(">IIBBBBB", WIDTH, PAGE_HEIGHT + TERMINAL_HEIGHT, 8, 2, 0, 0, 0)
        chunks = [(b"IHDR", head), (b"acTL", struct.pack(">II", len(frames), 0))]
        number = 0
        for index, (frame, shown_s) in enumerate(frames):
            place = (frame["width"], frame["height"], frame["left"], frame["top"], int(shown_s * 1000), 1000)
            chunks.append((b"fcTL", struct.pack(">5I2H2B", number, *place, 0, 0)))
            pixels = zlib.compress(base64.b64decode(frame["pixels"]), 9)
            kind, before = (b"IDAT", b"") if index == 0 else (b"fdAT", struct.pack(">I", number + 1))
            chunks.append((kind, before + pixels))
            number += 1 if index == 0 else 2
        return png_of(chunks)

    async def _frame(self) -> None:
        shot = base64.b64encode(await self._page.screenshot()).decode()
        text = html.escape("\n".join(self.terminal.splitlines()[-9:]))
        await self._stage.evaluate(
            "([png, text]) => { document.getElementById('terminal').innerHTML = text;"
            " const page = document.getElementById('page');"
            " page.src = 'data:image/png;base64,' + png; return page.decode(); }",
            [shot, text],
        )
        whole = base64.b64encode(await self._stage.screenshot()).decode()
        changed = await self._stage.evaluate(CHANGED, whole)
        if changed is not None:
            self._frames.append((changed, 0.0))


async def acted(film: Film, typed: str, config: str, port: str) -> None:
    """Carry out what is typed, its output in the terminal line by line."""
    film.terminal += f"$ {typed}\n"
    words = shlex.split(typed, comments=True)
    if words[0] == "starter-gateway":
        arguments = (config if word == "demo.toml" else word for word in words[1:])
        words = [sys.executable, "-m", "gateway", *arguments]
    else:
        words[1:1] = ["-p", port]
    process = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.PIPE)
    assert process.stdout is not None
    while line := await process.stdout.readline():
        film.terminal += line.decode()
    if await process.wait():
        raise RuntimeError(f"{typed} has failed")


async def main() -> None:
    """Film the demo and write the picture."""
    async with Program("gateway", "demo") as demo, async_playwright() as playwright:
        await demo.says("fan ready for remote control")
        await demo.says("pump ready for remote control")
        (url,) = re.findall(r"page +(http://\S+)", demo.output)
        (config,) = re.findall(r"config +(\S+)", demo.output)
        (port,) = re.findall(r"on 127\.0\.0\.1:(\d+)", demo.output)
        chromium = await playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        seen = {"viewport": {"width": WIDTH, "height": PAGE_HEIGHT}}
        stage = await chromium.new_page(viewport={"width": WIDTH, "height": PAGE_HEIGHT + TERMINAL_HEIGHT})
        await stage.set_content(STAGE)
        async with visitor(chromium, url, seen) as page:
            film = Film(stage, page)
            await film.watch(1.5)
            for typed, seconds in SCENES:
                acting = asyncio.create_task(acted(film, typed, config, port))
                await film.watch(seconds)
                await acting
            await film.watch(1.0)
        await chromium.close()
    picture = film.png()
    if len(picture) > MOST_BYTES:
        raise ValueError(f"{FILE.name} has {len(picture)} bytes, more than {MOST_BYTES}")
    FILE.write_bytes(picture)
    sys.stdout.write(f"{FILE.name}: {len(picture)} bytes\n")


if __name__ == "__main__":
    asyncio.run(main())
