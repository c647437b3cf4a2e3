"""`report`: the health report of a simulated year, as text and as a page."""

from __future__ import annotations

import ast
import asyncio
import csv
import re
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from gateway.cli.report import document
from gateway.cli.report.facts import PublishedFacts
from gateway.cli.report.html import to_html
from gateway.cli.report.plots import Plot, PlotLine, ticks
from gateway.cli.report.text import WIDTH, to_text
from gateway.families import LANGUAGES
from gateway.starters import FINGERPRINTS, KNOWN
from gateway.starters.identity.registry import Fingerprint, Known
from gateway.store import STATE_FILE, HistoryRow, write_document
from tests.history.year import STARTER, lived, report_of, write
from tests.rig import run_cli

EVIL = '<script>alert("1")</script>&'


@pytest.fixture(scope="module")
def year() -> list[HistoryRow]:
    """One start a day."""
    return asyncio.run(lived(per_day=1))


@pytest.fixture(scope="module")
def stored(year: list[HistoryRow], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return asyncio.run(write(tmp_path_factory.mktemp("year"), year))


def test_the_text_says_what_has_changed_and_by_how_much(stored: Path) -> None:
    text = to_text(report_of(stored))
    flowing = " ".join(text.split())

    drift = re.search(r"differ from the baseline: acceleration time \+(\d+) %, I²t \+\d+ %", flowing)
    row = re.search(r"acceleration time, s (\d+\.\d+) (\d+\.\d+) .*? \+(\d+) %", flowing)
    assert drift is not None
    assert row is not None
    assert 15 <= int(drift[1]) == int(row[3]) <= 30
    assert float(row[2]) / float(row[1]) == pytest.approx(1 + int(drift[1]) / 100, abs=0.01)
    for expected in ("E05 Motor overload", "SSW-07 200A", "2026-10", "operating hours 6 012 h"):
        assert expected in flowing
    assert re.search(r"P314 timeout for message recept… +10 s +5 s +maintenance", text)
    assert "check the cable after" in flowing
    assert "1.87 % corrupted, 0.51 % lost, 0.00 % late" in flowing


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_text_fits_a_terminal_and_the_page_stands_alone(stored: Path, language: str) -> None:
    text = to_text(report_of(stored, language))
    page = to_html(report_of(stored, language), language=language)

    assert max(map(len, text.splitlines())) <= WIDTH
    assert not re.search(r"<(script|link|img|iframe)|\s(src|href|on\w+)=", page)
    opened, closed = (re.findall(rf"<{slash}([a-z]\w*)(?:\s[^>]*[^>/])?>", page) for slash in ("", "/"))
    assert sorted(tag for tag in opened if tag != "meta") == sorted(closed)
    assert set(re.findall(r"\w+://[^\"' ]+", page)) == {"http://www.w3.org/2000/svg"}
    assert "url(" not in page
    assert "@page { size: A4" in page
    assert len(page.encode()) < 60_000


def test_each_word_of_the_report_is_listed_in_every_language() -> None:
    tree = ast.parse(Path(document.__file__).read_text("utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args]
    said = {
        call.args[0].value
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id == "t" and isinstance(call.args[0], ast.Constant)
    }
    with document.LABELS.open(encoding="utf-8", newline="") as file:
        listed = {row["en"]: row for row in csv.DictReader(file)}

    assert len(said) >= 39
    assert said - set(listed) == set()
    assert all(row[language] for row in listed.values() for language in LANGUAGES)


def test_the_plots_of_the_page_show_all_that_is_stored(stored: Path) -> None:
    page = to_html(report_of(stored), language="en")
    starts, *trends = [ElementTree.fromstring(each) for each in re.findall(r"<svg [^>]*role.*?</svg>", page)]
    kinds = [each.get("class") for each in starts.iter() if "curve" in each.get("class", "")]

    assert kinds == [*["curve earlier"] * 19, "curve latest", "curve baseline"]
    assert [each.get("aria-label") for each in trends] == [
        "acceleration time, s",
        "peak current, A",
        "I²t, 10⁶A²s",
    ]


def test_text_from_outside_is_escaped(year: list[HistoryRow], tmp_path: Path) -> None:
    trip = next(row for row in year if row.kind == "trip")
    rows = [row for row in year if row.kind != "trip"]
    rows.append(replace_data(trip, code=EVIL, text=EVIL, time=EVIL, state_before=EVIL))
    path = asyncio.run(write(tmp_path, rows))
    known = {STARTER: Known(Fingerprint(firmware=EVIL, serial=EVIL))}
    write_document(path.parent / "state" / STATE_FILE, FINGERPRINTS, KNOWN, known)
    published = PublishedFacts({"cable": {"texts": [EVIL]}}, {})

    page = to_html(report_of(path, published=published), language="en")

    assert "<script" not in page
    assert page.count(escape(EVIL)) >= 5


def test_a_starter_without_a_start_has_the_currents_of_its_size_in_any_language(tmp_path: Path) -> None:
    path = asyncio.run(write(tmp_path, []))
    known = {STARTER: Known(Fingerprint(rated_current="45 to 105 A"))}
    write_document(path.parent / "state" / STATE_FILE, FINGERPRINTS, KNOWN, known)

    assert re.search(r"corrente nominal +45\u2013105 A\n", to_text(report_of(path, "pt")))


def test_a_setting_changed_at_the_starter_stands_among_those_of_commands(
    year: list[HistoryRow], tmp_path: Path
) -> None:
    def seen(id_: str, time: str, before: float, after: float) -> HistoryRow:
        values = {"before": {"value": before, "unit": "s"}, "after": {"value": after, "unit": "s"}}
        data = {"time": time, "parameter": "P102", "name": "acceleration ramp time", **values}
        return HistoryRow(STARTER, "setting", id_, data, 100)

    rows = [*year, seen("a", "2026-01-02T03:04:05.678Z", 20.0, 25.0)]
    rows.append(seen("b", "2030-01-02T03:04:05.678Z", 25.0, 10.0))
    rows.append(replace_data(rows[-1], before=None, after={"value": 7, "label": "Inactive", "unit": ""}))
    path = asyncio.run(write(tmp_path, rows))

    text = run_cli("report", str(path), STARTER, "--no-broker").out

    table = text[text.index("Changed parameters") :]
    assert table.index("2030-01-02 03:04") < table.index("maintenance") < table.index("2026-01-02 03:04")
    assert re.search(r"2026-01-02 03:04 +P102 .* 20.0 s +25.0 s +at the starter", table)
    assert "7 Inactive" in text
    assert "left out: the broker was not asked" in " ".join(text.split())
    in_spanish = run_cli("report", str(path), STARTER, "--no-broker", "--language", "es").out
    assert "en el arrancador" in in_spanish


def replace_data(row: HistoryRow, **data: Any) -> HistoryRow:
    return row._replace(data={**row.data, **data})


def test_a_point_stands_where_the_axes_say() -> None:
    plot = Plot(
        "A", [PlotLine([(0.0, 0.0), (5.0, 50.0), (10.0, 100.0)], "latest")], width=256.0, height=133.0
    )
    root = ElementTree.fromstring(plot.svg())
    (path,) = (each.get("d", "") for each in root.iter() if each.get("class") == "curve latest")
    numbers = list(map(float, path.removeprefix("M").removesuffix("h0").split()))

    (x0, y0), (x1, y1), (x2, y2) = zip(numbers[::2], numbers[1::2], strict=True)
    assert (x0, x1, x2) == pytest.approx((46.0, 146.0, 246.0))
    assert (y2, y1, y0) == pytest.approx((16.0, 66.0, 116.0))


@pytest.mark.parametrize(
    ("least", "most"), [(0.0, 1.0), (0.0, 697.3), (-1.0, 16.6), (3.1, 3.1), (0.0, 4.6e6), (8.9, 11.4)]
)
def test_ticks_are_round_and_enclose_the_values(least: float, most: float) -> None:
    found = ticks(least, most, about=5)
    step = found[1] - found[0]

    assert found[0] <= least
    assert found[-1] >= most
    assert 2 <= len(found) <= 9
    mantissa = f"{step:e}".split("e")[0].rstrip("0").rstrip(".")
    assert mantissa in ("1", "2", "2.5", "5")
