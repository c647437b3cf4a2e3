"""`report`: the health report of a simulated year, as text and as a page."""

from __future__ import annotations

import asyncio
import re
import shutil
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from gateway.cli.report.html import to_html
from gateway.cli.report.labels import translator
from gateway.cli.report.plots import Plot, PlotLine, ticks
from gateway.cli.report.report import make_report
from gateway.cli.report.text import WIDTH, to_text
from gateway.store import HistoryRow
from tests.history.year import PUBLISHED, STARTER, Year, lived, write

LANGUAGES = ("en", "es", "pt")
EVIL = '<script>alert("1")</script>&'


@pytest.fixture(scope="module")
def year() -> Year:
    """One start a day."""
    return asyncio.run(lived(per_day=1))


@pytest.fixture(scope="module")
def stored(year: Year, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("year")
    yield asyncio.run(write(folder, year.rows))
    shutil.rmtree(folder)


def text_of(path: Path, language: str = "en", published: dict[str, Any] | None = None) -> str:
    made = make_report(path, STARTER, PUBLISHED if published is None else published, language)
    return to_text(made, translator(language))


def page_of(path: Path, language: str = "en", published: dict[str, Any] | None = None) -> str:
    made = make_report(path, STARTER, PUBLISHED if published is None else published, language)
    return to_html(made, translator(language), language=language)


def test_the_text_says_what_has_changed_and_by_how_much(stored: Path) -> None:
    text = text_of(stored)

    drift = re.search(r"acceleration time \+(\d+) %: (\d+\.\d+) s -> (\d+\.\d+) s", text)
    assert drift is not None
    assert float(drift[3]) / float(drift[2]) == pytest.approx(1 + int(drift[1]) / 100, abs=0.01)
    assert 15 <= int(drift[1]) <= 30
    for expected in ("E05 Motor overload", "SSW-07 200A", "2026-10", "starts left this hour", "5 h"):
        assert expected in text
    assert re.search(r"P314 timeout for message recept… +10 s +5 s +maintenance", text)
    assert "check the cable after" in text


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_line_of_the_text_is_wider_than_a_terminal(stored: Path, language: str) -> None:
    assert max(len(line) for line in text_of(stored, language).splitlines()) <= WIDTH


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_stands_alone_and_is_small(stored: Path, language: str) -> None:
    page = page_of(stored, language)

    assert not re.search(r"<(script|link|img|iframe)|\s(src|href|on\w+)=", page)
    opened, closed = (re.findall(rf"<{slash}([a-z]\w*)(?:\s[^>]*[^>/])?>", page) for slash in ("", "/"))
    assert sorted(tag for tag in opened if tag != "meta") == sorted(closed)
    assert set(re.findall(r"\w+://[^\"' ]+", page)) == {"http://www.w3.org/2000/svg"}
    assert "url(" not in page
    assert "@page { size: A4" in page
    assert len(page.encode()) < 60_000


def test_the_plots_of_the_page_are_whole_and_show_all_that_is_stored(stored: Path, year: Year) -> None:
    plots = [ElementTree.fromstring(each) for each in re.findall(r"<svg.*?</svg>", page_of(stored))]
    paths = [each for each in plots[0].iter() if each.get("fill") == "none"]
    months = [row for row in year.rows if row.kind == "month"]
    columns = [each for each in plots[4].iter() if each.tag.endswith("rect")]

    assert len(plots) == 5
    assert len(paths) == 20 + 1  # curves and the baseline
    assert len(columns) == len(months)


def test_what_comes_from_outside_is_escaped(year: Year, tmp_path: Path) -> None:
    trip = next(row for row in year.rows if row.kind == "trip")
    rows = [row for row in year.rows if row.kind != "trip"]
    rows.append(replace_data(trip, code=EVIL, text=EVIL, time=EVIL, state_before=EVIL))
    path = asyncio.run(write(tmp_path, rows))
    line = {"cable": {"texts": [EVIL]}, "units": {"7": {"asked": 1}}}
    info = {"firmware": EVIL, "serial": EVIL, "model": EVIL}
    base = "starters/cement-mill"
    published = {f"{base}/gateway/line/cooling": line, f"{base}/starter/{STARTER}/info": info}

    page = page_of(path, published=published)

    assert "<script" not in page
    assert page.count(escape(EVIL)) >= 5


def test_a_setting_changed_at_the_starter_stands_among_those_of_commands(year: Year, tmp_path: Path) -> None:
    def seen(id_: str, time: str, before: float, after: float) -> HistoryRow:
        values = {"before": {"value": before, "unit": "s"}, "after": {"value": after, "unit": "s"}}
        data = {"time": time, "parameter": "P102", "name": "acceleration ramp time", **values}
        return HistoryRow(STARTER, "setting", id_, data, 100)

    rows = [*year.rows, seen("a", "2026-01-02T03:04:05.678Z", 20.0, 25.0)]
    rows.append(seen("b", "2030-01-02T03:04:05.678Z", 25.0, 10.0))
    rows.append(replace_data(rows[-1], before=None, after={"value": 7, "label": "Inactive", "unit": ""}))

    path = asyncio.run(write(tmp_path, rows))
    text, page = text_of(path), page_of(path, "es")

    table = text[text.index("Changed parameters") :]
    assert table.index("2030-01-02 03:04") < table.index("maintenance") < table.index("2026-01-02 03:04")
    assert re.search(r"2026-01-02 03:04 +P102 .* 20.0 s +25.0 s +at the starter", table)
    assert "en el arrancador" in page
    assert "7 Inactive" in text


def replace_data(row: HistoryRow, **data: Any) -> HistoryRow:
    return row._replace(data={**row.data, **data})


def test_a_point_stands_where_the_axes_say() -> None:
    plot = Plot(256.0, 145.0, "s", "A", [PlotLine([(0.0, 0.0), (5.0, 50.0), (10.0, 100.0)])])
    root = ElementTree.fromstring(plot.svg())
    (path,) = (each.get("d", "") for each in root.iter() if each.get("fill") == "none")
    numbers = list(map(float, path.removeprefix("M").split()))

    (x0, y0), (x1, y1), (x2, y2) = zip(numbers[::2], numbers[1::2], strict=True)
    assert (x0 + x2) / 2 == pytest.approx(x1, abs=0.1)
    assert (y0 + y2) / 2 == pytest.approx(y1, abs=0.1)
    assert (x0, x2) == pytest.approx((46.0, 246.0))
    assert (y2, y0) == pytest.approx((16.0, 116.0))


@pytest.mark.parametrize(
    ("least", "most"), [(0.0, 1.0), (0.0, 697.3), (-1.0, 16.6), (3.1, 3.1), (0.0, 4.6e6), (8.9, 11.4)]
)
def test_ticks_are_round_and_enclose_the_values(least: float, most: float) -> None:
    found = ticks(least, most, 5)
    step = found[1] - found[0]

    assert found[0] <= least
    assert found[-1] >= most
    assert 2 <= len(found) <= 9
    mantissa = f"{step:e}".split("e")[0].rstrip("0").rstrip(".")
    assert mantissa in ("1", "2", "2.5", "5")
