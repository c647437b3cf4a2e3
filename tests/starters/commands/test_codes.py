"""The list of result codes is closed: the code knows no other, and the page has them all."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

from gateway.families.command.interlock import RULES as INTERLOCKS
from gateway.families.command.interlock import UNKNOWN_CODE
from gateway.families.profile.procedure import REFUSALS
from gateway.modbus.codes import ExceptionCode
from gateway.starters.commands.result_codes import CODES, explain
from gateway.starters.commands.starter_io import exception_code_word
from gateway.starters.policy.start_rules import RULES
from tests.results_page import PAGE, page

GATEWAY = Path(__file__).parents[3] / "gateway"
ROOMS = (
    "families",
    "starters",
    "app/history",
    "mqtt/contract/commands.py",
    "mqtt/contract/freshness.py",
    "storage",
)

# Where the code stands in a call.
PLACES = {"CommandError": 0, "refused": 0, "halt": 0, "_cut": 0, "Final": 1}
KEYWORDS = {"CommandError", "Expectation", "Final", "replace", "Rejection"}

NAMED_ELSEWHERE = {
    "identity_unknown",
    "identity_mismatch",
    "identity_changed",
    "slot_mismatch",
    "not_as_expected",
}  # made of parts, or defaults


def sources() -> Iterator[Path]:
    for room in ROOMS:
        path = GATEWAY / room
        yield from [path] if path.is_file() else sorted(path.rglob("*.py"))


def codes_in(path: Path) -> Iterator[str]:
    """Return the codes that a module gives as a word or as a constant of its own."""
    module = importlib.import_module(".".join(path.relative_to(GATEWAY.parent).with_suffix("").parts))
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        found = [keyword.value for keyword in node.keywords if keyword.arg == "code" and name in KEYWORDS]
        if name in PLACES and len(node.args) > PLACES[name]:
            found.append(node.args[PLACES[name]])
        for value in found:
            word = getattr(module, value.id, None) if isinstance(value, ast.Name) else None
            word = value.value if isinstance(value, ast.Constant) else word
            if isinstance(word, str):
                yield word


def listed() -> list[str]:
    return [code for codes in CODES.values() for code in codes]


def given() -> set[str]:
    words = {code for path in sources() for code in codes_in(path)}
    interlocks = {UNKNOWN_CODE, *(rule.code for rule in INTERLOCKS.values())}
    exceptions = {exception_code_word(code) for code in ExceptionCode}
    return words | exceptions | NAMED_ELSEWHERE | REFUSALS.keys() | interlocks | RULES.keys()


def test_every_code_that_the_gateway_gives_is_in_the_list() -> None:
    assert given() - set(listed()) == set()


def test_the_list_has_no_code_that_nothing_gives() -> None:
    assert set(listed()) - given() == set()


def test_no_code_stands_twice() -> None:
    assert len(listed()) == len(set(listed()))


def test_the_page_says_what_the_list_says() -> None:
    text = PAGE.read_text("utf-8")

    assert text == page(text), "run: python -m tests.results_page"


def test_a_code_is_explained_also_when_it_is_not_in_the_list() -> None:
    assert explain("locked").hint == "Ask who locked it."
    assert "Modbus exception" in explain("exception_77").sentence
