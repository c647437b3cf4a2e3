"""The table of results: what the code says fits it, all of it is said, and no text is made elsewhere."""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from gateway.contract import Note, Reason, ResultCode, meaning_of
from gateway.contract.results import NOTES, RESULTS
from gateway.contract.wording import names_in
from gateway.families.command.interlock import _STATE_CODES, RULES
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.starters.command.wire import exception_result
from gateway.starters.identity.standing import _CODES

GATEWAY = Path(__file__).parents[2] / "gateway"
MAKERS = ("CommandError", "Reason")
COMMANDS = [command for name in FAMILIES for command in load_profile(name).commands.values()]

# Where a code or a case is not written out: what it may be.
CODES: dict[str, Collection[str]] = {
    "families/command/interlock.py": {*RULES.values(), *_STATE_CODES.values()},
    "families/command/procedures.py": {
        each.refusal for command in COMMANDS for each in command.ceilings.values()
    },
    "starters/policy/preconditions.py": {ResultCode.NOT_AS_EXPECTED, ResultCode.STATE_CHANGED},
    "starters/identity/standing.py": set(_CODES.values()),
    "starters/command/wire.py": {exception_result(number) for number in range(256)},
}
CASES: dict[str, Collection[str]] = {"families/command/interlock.py": RULES.keys()}


@dataclass(frozen=True)
class Use:
    """One place that says something from the table; a note has the code "notes"."""

    where: str
    code: str
    case: str
    fields: frozenset[str | None]


CALLS = [
    (str(path.relative_to(GATEWAY)), node.func.id, node)
    for path in sorted(GATEWAY.rglob("*.py"))
    if path != GATEWAY / "contract" / "results.py"
    for node in ast.walk(ast.parse(path.read_text("utf-8")))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
]
TABLE = {
    **{(code, case): text for code, means in RESULTS.items() for case, text in means.texts.items()},
    **{("notes", case): text for case, text in NOTES.items()},
}


def calls(*names: str) -> Iterator[tuple[str, ast.Call]]:
    return ((file, call) for file, name, call in CALLS if name in names)


def is_added_to(node: ast.expr) -> bool:
    """Return whether a reason is meant that was made before, with more to say."""
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "noted"


def codes_of(node: ast.expr, file: str) -> Collection[str]:
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "ResultCode":
        return (ResultCode[node.attr].value,)
    return CODES[file]


def cases_of(node: ast.expr | None, file: str) -> Collection[str]:
    if node is None:
        return ("",)
    if isinstance(node, ast.IfExp):
        return (*cases_of(node.body, file), *cases_of(node.orelse, file))
    return (str(node.value),) if isinstance(node, ast.Constant) else CASES[file]


def uses() -> Iterator[Use]:
    for file, call in calls("Note", *MAKERS):
        is_note = ast.unparse(call.func) == "Note"
        if is_added_to(call.args[0]):
            continue
        code, case = (None, call.args[0]) if is_note else (call.args[0], [*call.args, None][1])
        fields = frozenset(keyword.arg for keyword in call.keywords)
        for each in ("notes",) if code is None else codes_of(code, file):
            yield from (Use(f"{file}:{call.lineno}", each, word, fields) for word in cases_of(case, file))


def test_the_codes_are_those_of_the_table_in_its_order() -> None:
    assert list(RESULTS) == [code.value for code in ResultCode]


def test_each_use_names_a_text_of_the_table_with_exactly_its_fields() -> None:
    found = list(uses())
    wrong = [use for use in found if TABLE.get((use.code, use.case)) is None]
    wrong += [use for use in found if use not in wrong and names_in(TABLE[use.code, use.case]) != use.fields]

    assert wrong == []
    assert len(found) > 200


def test_each_text_of_the_table_is_used() -> None:
    assert TABLE.keys() - {(use.code, use.case) for use in uses()} == set()


def test_no_text_of_a_result_is_made_elsewhere() -> None:
    """A field may be a list or a number, but no sentence; a text is a reason's, or several joined."""
    made = [
        f"{file}:{call.lineno} {keyword.arg}"
        for file, call in calls("Note", *MAKERS)
        for keyword in call.keywords
        for part in ast.walk(keyword.value)
        if isinstance(part, ast.JoinedStr) and re.search(r"[a-z]+ [a-z]+", ast.unparse(part))
    ]
    made += [
        f"{file}:{call.lineno} text"
        for file, call in calls("ResultRecord", "replace")
        for keyword in call.keywords
        if keyword.arg == "text"
        for part in ast.walk(keyword.value)
        if isinstance(part, (ast.JoinedStr, ast.BinOp))
    ]

    assert made == []


def test_a_text_is_a_clause_and_a_meaning_a_sentence() -> None:
    sentences = [each for means in RESULTS.values() for each in (means.sentence, means.remedy)]

    assert [text for text in TABLE.values() if re.match(r"[A-Z][a-z]|.*[. ;]$", text)] == []
    assert [each for each in sentences if not re.match(r"[A-Z`].*\.$", each)] == []


@pytest.mark.parametrize(
    ("code", "case", "fields"),
    [
        (ResultCode.EXPIRED, "token", {"age_s": 7.3, "ttl_s": 5.0, "client": "alice"}),
        (ResultCode.EXPIRED, "token", {"age_s": 7.3}),
        (ResultCode.EXPIRED, "tokens", {"age_s": 7.3, "ttl_s": 5.0}),
        (ResultCode.EXPIRED, "", {}),
    ],
)
def test_what_does_not_fit_the_table_is_an_error(
    code: ResultCode, case: str, fields: dict[str, object]
) -> None:
    with pytest.raises(ValueError, match=r"results\.toml"):
        Reason(code, case, **fields)


def test_a_reason_and_what_is_added_make_one_text() -> None:
    reason = Reason(ResultCode.EXPIRED, "waiting", age_s=7.26).noted(Note("nothing_written"), None)

    assert reason.text == "the command arrived 7.3 s ago and is no longer valid; nothing was written"
    assert reason.code == "expired"
    assert reason.noted() == reason != Reason(ResultCode.EXPIRED, "message")


def test_an_exception_that_no_manual_names_has_its_number_in_the_code() -> None:
    assert Reason(ResultCode.EXCEPTION, "write", number=77).code == "exception_77"
    assert meaning_of("exception_77").remedy == "See its manual."
    assert meaning_of("locked").remedy == "Ask the owner of the lock."
