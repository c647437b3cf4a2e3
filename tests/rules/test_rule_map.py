"""The page that says which test exercises which rule of the manuals is complete and true."""

from __future__ import annotations

import re
from pathlib import Path

TESTS = Path(__file__).parents[1]
PAGE = (TESTS.parent / "docs" / "rules.md").read_text(encoding="utf-8")
COUNTS = {"W": 13, "S6": 24, "S7": 14, "S9": 25, "ST": 26, "X": 11}

ROW = re.compile(r"^\| ((?:W|S6|S7|S9|ST|X)-\d\d) \| (.+) \| (.+) \|$", re.MULTILINE)
NAMED = re.compile(r"`([\w/]+\.py)::(test_\w+)`")


def rows() -> dict[str, str]:
    found = ROW.findall(PAGE)
    assert len(found) == len(dict.fromkeys(number for number, _, _ in found))
    return {number: cell for number, _, cell in found}


def test_every_rule_of_the_manuals_stands_in_the_map_once() -> None:
    expected = [f"{part}-{number:02d}" for part, count in COUNTS.items() for number in range(1, count + 1)]

    assert list(rows()) == expected


def test_every_rule_names_a_test_or_the_reason_why_it_has_none() -> None:
    for number, cell in rows().items():
        assert NAMED.search(cell) or cell.startswith("not testable: "), number


def test_every_test_that_the_map_names_exists() -> None:
    missing = [
        f"{file}::{name}"
        for cell in rows().values()
        for file, name in NAMED.findall(cell)
        if not (TESTS / file).is_file()
        or not re.search(
            rf"^(def {name}\(|{name} = )", (TESTS / file).read_text(encoding="utf-8"), re.MULTILINE
        )
    ]

    assert missing == []


def test_every_table_that_the_map_names_for_a_rule_has_a_row_of_it() -> None:
    tables = [
        (number, file)
        for number, cell in rows().items()
        for file, name in NAMED.findall(cell)
        if name.endswith(("_keeps_the_rules_of_its_manual", "_keeps_the_times_of_the_manuals"))
    ]

    assert len(tables) > 60
    assert [each for each in tables if each[0] not in (TESTS / each[1]).read_text(encoding="utf-8")] == []


def test_the_page_counts_its_rules_rightly() -> None:
    tested = sum(bool(NAMED.search(cell)) for cell in rows().values())

    assert f"{len(rows())} numbered rules" in PAGE
    assert f"{tested} are exercised by the tests named here" in PAGE
