"""Writes docs/pictures/report.png, the health report of a simulated year: `python -m tests.report_picture`.

Chromium draws it; it is no part of the program.
"""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from gateway.cli.report.html import to_html
from gateway.cli.report.labels import translator
from gateway.cli.report.report import make_report
from tests.history.year import STARTER, lived, write

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "report.png"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SIZE = "760,1930"  # CSS pixels

PUBLISHED: dict[str, dict[str, Any]] = {
    "starters/cement-mill/gateway/line/cooling": {
        "utilisation": 0.41,
        "units": {
            "7": {
                "asked": 1_904_322,
                "answered": 1_898_006,
                "silent": 1407,
                "corrupted": 4909,
                "late": 0,
                "response_time_s": {"p50": 0.0121, "p99": 0.0184},
            }
        },
        "cable": {
            "texts": [
                "errors from cooling-fan-2 (address 7) on: check the cable after cooling-fan-1 "
                "(address 6) (2.4 % of 1180 replies in 10 min: 22 corrupted, 6 lost)"
            ],
            "starters": {STARTER: {"error_rate": 0.0187, "silent_rate": 0.0051, "late_rate": 0.0}},
        },
    },
    f"starters/cement-mill/starter/{STARTER}/value/starts_left": {"value": 4},
    f"starters/cement-mill/starter/{STARTER}/value/standstill_s": {"value": 27_400.0},
    f"starters/cement-mill/starter/{STARTER}/info": {"firmware": "1.60", "rated_current_a": 200},
}


async def sample(folder: Path) -> str:
    """Return the page of a simulated year."""
    path = await write(folder, (await lived()).rows)
    return to_html(make_report(path, STARTER, PUBLISHED, "en"), translator("en"), language="en")


def main() -> int:
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        print(f"none of {', '.join(BROWSERS)} is installed", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        page = folder / "report.html"
        page.write_text(asyncio.run(sample(folder)), encoding="utf-8")
        PICTURE.parent.mkdir(exist_ok=True)
        command = (
            browser,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--force-device-scale-factor=1",
            f"--user-data-dir={folder / 'profile'}",
            f"--window-size={SIZE}",
            f"--screenshot={PICTURE}",
            page.as_uri(),
        )
        subprocess.run(command, check=True, capture_output=True, timeout=120)
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1024:.0f} KB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
