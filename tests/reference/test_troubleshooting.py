"""docs/troubleshooting.md says only what the program says."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

from gateway.contract import EventCode, ResultCode
from gateway.contract.events import EVENTS
from gateway.contract.results import NOTES, RESULTS
from tests.reference.contract_pages import TOPICS

ROOT = Path(__file__).parents[2]
ROWS = [
    line.split(" | ")
    for line in (ROOT / "docs" / "troubleshooting.md").read_text("utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| it says")
]
EVENT_CODES = set(EventCode)
RESULT_CODES = set(ResultCode)
WORDS = {"scan", "stale", "bad", "garbled", "unconfirmed", "uart_errors", "B/gateway/line/{line}"}


@functools.cache
def texts() -> str:
    """Return every text of the source, what is filled in as …."""
    templates = [
        text for event in EVENTS.values() for text in (*event.texts.values(), *event.phrases.values())
    ]
    templates += [*NOTES.values()]
    templates += [text for means in RESULTS.values() for text in means.texts.values()]
    found = [re.sub(r"\{[^}]*\}", "…", template) for template in templates]
    for path in sorted((ROOT / "gateway").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                found.append("".join(v.value if isinstance(v, ast.Constant) else "…" for v in node.values))  # type: ignore[misc]
    return "\n".join(found)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0][2:60])
def test_a_symptom_is_what_the_program_says(row: list[str]) -> None:
    for said in re.findall(r"`([^`]+)`", row[0]):
        is_code = said in EVENT_CODES | RESULT_CODES | WORDS
        assert is_code or said in texts(), f"the program never says {said!r}"
    for code in re.findall(r"event `(\w+)`", row[0]):
        assert code in EVENT_CODES


def test_every_row_has_symptom_cause_and_remedy() -> None:
    assert {len(row) for row in ROWS} == {3}
    assert len(ROWS) >= 25


def test_every_topic_that_is_named_exists() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text("utf-8")
    known = {topic.address for topic in TOPICS}

    assert set(re.findall(r"`B/([\w/{}]+)`", page)) <= known
