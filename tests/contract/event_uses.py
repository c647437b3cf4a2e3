"""Every use of an event in the source: the calls that name a code, with the case and the fields they give."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "gateway"
FAULT = "BusFault"  # an event but for the line and its frames, which `Plant` adds
ADDED_TO_FAULT = frozenset({"line", "unit", "frames"})
NAMES_OF_RELOAD = "changes.to_dict()"  # the only fields that no keyword names


@dataclass(frozen=True)
class Use:
    """A call that names a code."""

    place: str  # file and line
    callee: str
    code: str
    case: str
    fields: frozenset[str]
    severity: str  # empty: none is given; `?`: computed
    values: tuple[ast.expr, ...]  # what the fields are made of, local names resolved

    def __str__(self) -> str:
        return f"{self.place} {self.callee} {self.code} {self.case}"


def modules() -> Iterator[tuple[str, ast.Module]]:
    """Give each module of the product with its path below gateway/."""
    for path in sorted(SOURCE.rglob("*.py")):
        text = path.read_text("utf-8")
        if "EventCode" in text or "EventRecord" in text or "Event(" in text:
            yield path.relative_to(SOURCE).as_posix(), ast.parse(text)


def uses() -> tuple[Use, ...]:
    """Return all of them; an expression that cannot be read off the source is an error."""
    return tuple(use for name, module in modules() for use in _uses_in(name, module))


def calls_of(module: ast.Module, callee: str) -> Iterator[ast.Call]:
    """Give the calls of a function or method by its last name."""
    for node in ast.walk(module):
        if isinstance(node, ast.Call) and callee_of(node) == callee:
            yield node


def callee_of(call: ast.Call) -> str:
    """Return the last name of what is called."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)


def keys_in(path: str, function: str) -> frozenset[str]:
    """Return the keys of the dictionaries that a function writes down."""
    module = ast.parse((SOURCE / path).read_text("utf-8"))
    body = next(node for node in _functions(module) if node.name == function)
    dictionaries = (node for node in ast.walk(body) if isinstance(node, ast.Dict))
    return frozenset(ast.literal_eval(key) for each in dictionaries for key in each.keys if key is not None)


def is_composed(value: ast.expr) -> bool:
    """Return whether a value is a text of several pieces with words in it."""
    for node in ast.walk(value):
        match node:
            case ast.JoinedStr(values=pieces):
                if any(_has_words(piece) for piece in pieces):
                    return True
            case ast.BinOp(left=left, op=ast.Add() | ast.Mod(), right=right):
                if _has_words(left) or _has_words(right):
                    return True
            case ast.Call(func=ast.Attribute(value=template, attr="format")):
                if _has_words(template):
                    return True
    return False


def _has_words(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and any(sign.isalpha() for sign in str(node.value))


def _functions(module: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def _uses_in(name: str, module: ast.Module) -> Iterator[Use]:
    functions = list(_functions(module))
    for call in (node for node in ast.walk(module) if isinstance(node, ast.Call)):
        at = next((place for place, each in enumerate(call.args[:2]) if _codes(each)), None)
        if at is None:
            continue
        around = [each for each in functions if each.lineno <= call.lineno <= (each.end_lineno or 0)]
        scope = max(around, key=lambda each: each.lineno) if around else module
        callee, named = callee_of(call), {each.arg: each.value for each in call.keywords}
        case_at = 2 if callee == FAULT else at + 1
        assert len(call.args) <= case_at + 1, f"{name}:{call.lineno}: too many positions"
        cases = _texts(call.args[case_at]) if len(call.args) > case_at else ("",)
        severity = named.pop("severity", None)
        fields, values = _fields(callee, named)
        for code in _codes(call.args[at]):
            for case in cases:
                yield Use(
                    f"{name}:{call.lineno}",
                    callee,
                    code,
                    case,
                    fields,
                    "" if severity is None else _severity(severity),
                    tuple(found for value in values for found in _resolved(value, scope)),
                )


def _fields(callee: str, named: dict[str | None, ast.expr]) -> tuple[frozenset[str], list[ast.expr]]:
    values = [value for key, value in named.items() if key is not None]
    if callee == FAULT:
        given = named.pop("fields", ast.Dict([], []))
        assert isinstance(given, ast.Dict), ast.unparse(given)
        keys = {ast.literal_eval(key) for key in given.keys if key is not None}
        return ADDED_TO_FAULT | keys, values
    spread = named.pop(None, None)
    names = {str(key).removesuffix("_") for key in named}
    if spread is not None:
        assert ast.unparse(spread) == NAMES_OF_RELOAD, ast.unparse(spread)
        names |= keys_in("config/diff.py", "to_dict")
    return frozenset(names), values


def _codes(node: ast.expr) -> tuple[str, ...]:
    match node:
        case ast.Attribute(value=ast.Name(id="EventCode"), attr=name):
            return (name,)
        case ast.IfExp(body=body, orelse=other):
            return (*_codes(body), *_codes(other))
    return ()


def _texts(node: ast.expr) -> tuple[str, ...]:
    match node:
        case ast.Constant(value=str(text)):
            return (text,)
        case ast.IfExp(body=body, orelse=other):
            return (*_texts(body), *_texts(other))
    raise AssertionError(f"line {node.lineno}: a case is written out, not {ast.unparse(node)}")


def _severity(node: ast.expr) -> str:
    match node:
        case ast.Attribute(value=ast.Name(id="Severity"), attr=name):
            return name.lower()
    return "?"


def _resolved(value: ast.expr, scope: ast.AST) -> Iterator[ast.expr]:
    """Give a value, and for a local name all that is assigned to it."""
    yield value
    if not isinstance(value, ast.Name):
        return
    for node in ast.walk(scope):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=assigned) if name == value.id:
                yield assigned
            case ast.AugAssign(target=ast.Name(id=name), value=assigned) if name == value.id:
                yield assigned
