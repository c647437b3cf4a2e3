"""The documentation site: complete, without dead links, and without anything from another host."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
import yaml

from tests.reference.site_hooks import DOCS, ROOT, TAKEN_IN

LOADS = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href", "object": "data"}


class Page(HTMLParser):
    """What a page of the site loads, where its links lead, and what they can lead to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.anchors |= {str(found[key]) for key in ("id", "name") if found.get(key)}
        if tag in LOADS and found.get(LOADS[tag]) and found.get("rel") != "canonical":
            self.loads.append(str(found[LOADS[tag]]))
        if tag == "a" and found.get("href"):
            self.links.append(str(found["href"]))


DAY_OF_THE_BUILD = datetime(2001, 2, 3, tzinfo=UTC)


def pages_in(nav: Any) -> Iterator[str]:
    """Give every page of the navigation, in its order."""
    if isinstance(nav, str):
        yield nav
    else:
        for each in nav.values() if isinstance(nav, dict) else nav:
            yield from pages_in(each)


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


def test_the_navigation_has_every_page_once() -> None:
    listed = list(pages_in(yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))["nav"]))
    written = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")} | set(TAKEN_IN)

    assert sorted(listed) == sorted(written)  # else: mkdocs.yml


def test_nothing_of_the_site_is_loaded_from_another_host(site: Path, pages: dict[Path, Page]) -> None:
    foreign = [each for page in pages.values() for each in page.loads if urlsplit(each).netloc]
    styles = "\n".join(path.read_text("utf-8") for path in site.rglob("*.css"))

    assert foreign == []
    assert re.findall(r"url\(\s*[\"']?https?:|@import\s+[\"']?(?:url\()?https?:", styles) == []


def test_no_link_of_the_site_is_dead(pages: dict[Path, Page]) -> None:
    dead = []
    for path, page in pages.items():
        if path.name == "404.html":
            continue  # shown for any path
        for link in (*page.links, *page.loads):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            anchors = pages[target].anchors if target in pages else {parts.fragment}
            if not target.exists() or (parts.fragment and unquote(parts.fragment) not in anchors):
                dead.append(f"{path.name}: {link}")
    assert dead == []


def test_the_site_is_small_enough_to_ship(site: Path) -> None:
    assert sum(path.stat().st_size for path in site.rglob("*") if path.is_file()) < 6_000_000
