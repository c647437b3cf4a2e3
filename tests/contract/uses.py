"""Every use of the tables of words in the source: which code is named, in which case, with which fields."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from gateway.contract import EventCode, ResultCode
from gateway.contract.events import EVENTS
from gateway.families.command.interlock import _STATE_CODES, RULES
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.parameters import NOT_SETTABLE
from gateway.starters.command.wire import exception_result
from gateway.starters.identity.standing import _CODES

GATEWAY = Path(__file__).parents[2] / "gateway"
COMMANDS = [command for name in FAMILIES for command in load_profile(name).commands.values()]
RESULT_MAKERS = ("CommandError", "Reason")
FAULT = "BusFault"  # an event but for the line and its frames, which `Plant` adds
ADDED_TO_FAULT = frozenset({"line", "unit", "frames"})

# Where the code or the case of a result is not written out: what it may be.
CODES: dict[str, Collection[str]] = {
    "families/command/interlock.py": {*RULES.values(), *_STATE_CODES.values()},
    "families/command/procedures.py": {
        each.refusal for command in COMMANDS for each in command.ceilings.values()
    },
    "starters/policy/preconditions.py": {ResultCode.NOT_AS_EXPECTED, ResultCode.STATE_CHANGED},
    "starters/identity/standing.py": set(_CODES.values()),
    "starters/command/wire.py": {exception_result(number) for number in range(256)},
}
CASES: dict[str, Collection[str]] = {
    "families/command/interlock.py": RULES.keys(),
    "families/profile/parameters.py": NOT_SETTABLE.keys(),
}


@dataclass(frozen=True)
class Use:
    """One place that says something: `table` is events, phrases, results or notes (which have no code)."""

    where: str
    table: str
    code: str
    case: str
    fields: frozenset[str]
    severity: str = ""  # empty: none is given; `?`: computed


def _calls() -> Iterator[tuple[str, ast.Call]]:
    for path in sorted(GATEWAY.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call):
                yield path.relative_to(GATEWAY).as_posix(), node


def callee(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)


def uses() -> Iterator[Use]:
    """Yield all of them; an expression that cannot be read off the source is an error."""
    for file, call in _calls():
        where, name, args = f"{file}:{call.lineno}", callee(call), call.args
        fields = frozenset(
            each.arg.removesuffix("_") for each in call.keywords if each.arg not in (None, "severity")
        )
        at = next((place for place, each in enumerate(args[:2]) if _named(each, "EventCode")), None)
        if at is not None:
            yield from _events(file, call, at, fields)
        elif name == "Note":
            yield from (Use(where, "notes", "", case, fields) for case in _cases(args[0], file))
        elif name in RESULT_MAKERS and file != "contract/results.py" and callee_of(args[0]) != "noted":
            for code in _named(args[0], "ResultCode") or CODES[file]:
                for case in _cases([*args, None][1], file):
                    yield Use(where, "results", code, case, fields)


def callee_of(node: ast.expr) -> str:
    return callee(node) if isinstance(node, ast.Call) else ""


def _events(file: str, call: ast.Call, at: int, fields: frozenset[str]) -> Iterator[Use]:
    name, given = callee(call), {each.arg: each.value for each in call.keywords}
    case_at = 2 if name == FAULT else at + 1
    assert len(call.args) <= case_at + 1, f"{file}:{call.lineno}: too many positions"
    severities = (_named(given["severity"], "Severity") or ("?",)) if "severity" in given else ("",)
    if name == FAULT:
        keys = given["fields"].keys if isinstance(given.get("fields"), ast.Dict) else ()  # type: ignore[union-attr]
        fields = ADDED_TO_FAULT | {str(ast.literal_eval(key)) for key in keys if key}
    elif None in given:
        fields |= EVENTS[EventCode.RELOADED].data.keys()  # `changes.to_dict()`, which the reloads check
    for code in _named(call.args[at], "EventCode"):
        for case in _cases([*call.args, *[None] * 3][case_at], file):
            table = "phrases" if name == "phrase" else "events"
            for severity in severities:
                yield Use(f"{file}:{call.lineno}", table, code, case, fields, severity)


def _named(node: ast.expr, kind: str) -> tuple[str, ...]:
    """Return the values of the members of an enum that an expression names."""
    match node:
        case ast.Attribute(value=ast.Name(id=name), attr=member) if name == kind:
            return (member.lower(),)
        case ast.IfExp(body=body, orelse=other):
            return (*_named(body, kind), *_named(other, kind))
    return ()


def _cases(node: ast.expr | None, file: str) -> Collection[str]:
    match node:
        case None:
            return ("",)
        case ast.IfExp(body=body, orelse=other):
            return (*_cases(body, file), *_cases(other, file))
        case ast.Constant(value=str(text)):
            return (text,)
    return CASES[file]


assert all(code.name.lower() == code.value for codes in (EventCode, ResultCode) for code in codes)
