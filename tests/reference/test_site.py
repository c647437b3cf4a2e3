"""The documentation site: nothing is missing in it, and nothing comes from another host.

Its strict build fails for a page that the navigation lacks and for a dead link (`validation` in mkdocs.yml).
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tests.reference.site_hooks import ROOT

LOADS = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href", "object": "data"}


class Page(HTMLParser):
    """The files that a page of the site loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        if tag in LOADS and found.get(LOADS[tag]) and found.get("rel") != "canonical":
            self.loads.append(str(found[LOADS[tag]]))


DAY_OF_THE_BUILD = datetime(2001, 2, 3, tzinfo=UTC)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "SOURCE_DATE_EPOCH": str(int(DAY_OF_THE_BUILD.timestamp()))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path.read_text("utf-8")) for path in site.rglob("*.html")}


def test_nothing_in_the_site_says_on_which_day_it_was_built(site: Path) -> None:
    day = DAY_OF_THE_BUILD.strftime("%Y-%m-%d").encode()

    assert [path for path in site.rglob("*") if path.is_file() and day in path.read_bytes()] == []
    assert list(site.rglob("*.gz")) == []  # they carry a time


def test_nothing_of_the_site_is_loaded_from_another_host(site: Path, pages: dict[Path, Page]) -> None:
    foreign = [each for page in pages.values() for each in page.loads if urlsplit(each).netloc]
    styles = "\n".join(path.read_text("utf-8") for path in site.rglob("*.css"))

    assert foreign == []
    assert re.findall(r"url\(\s*[\"']?https?:|@import\s+[\"']?(?:url\()?https?:", styles) == []


def test_everything_that_a_page_loads_is_there(pages: dict[Path, Page]) -> None:
    loads = [
        path.parent / unquote(urlsplit(each).path)
        for path, page in pages.items()
        if path.name != "404.html"  # shown for any path
        for each in page.loads
    ]

    assert [path for path in loads if not path.exists()] == []


def test_the_site_is_small_enough_to_ship(site: Path) -> None:
    assert sum(path.stat().st_size for path in site.rglob("*") if path.is_file()) < 6_000_000
