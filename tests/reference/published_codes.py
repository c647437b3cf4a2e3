"""Collects every event code that the source publishes, with its severities and the keys of its data.

A code stands right before its severity, in whatever call. Where that is no literal it is a constant, a
local choice between literals, or a parameter of a helper whose callers name it; the rest is in `ELSEWHERE`.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gateway.line.rtu import bus_faults

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "gateway"
SEVERITIES = ("INFO", "WARNING", "ERROR")

# What is published under a code that another module gives: (module, expression) -> the codes.
ELSEWHERE: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("app/plant.py", "event.code"): (
        bus_faults.ADDRESS_CONFLICT,
        bus_faults.BABBLING,
        bus_faults.LINE_NOISE,
    ),
    # Home Assistant needs no package.
    ("app/integrations/integration.py", "f'{self.name}_away'"): ("metrics_away", "sparkplug_away"),
    ("app/uplink.py", "notice.code"): ("client_id_taken", "message_too_large"),  # reconnect.Notice
}
# Where the data comes from a function: code -> (module, function), .. All keys in that function may be in it.
MADE_BY: Mapping[str, tuple[tuple[str, str], ...]] = {
    "gap": (("mqtt/outbox/losses.py", "_summary"),),
    "identity_accepted": (("starters/identity/registry.py", "_as_data"),),
    "identity_changed": (("starters/identity/registry.py", "_as_data"),),
    "reloaded": (("config/diff.py", "to_dict"),),
    "fault": (
        ("starters/telemetry/status.py", "_values_before"),
        ("starters/telemetry/transitions.py", "_duration"),
        ("starters/telemetry/transitions.py", "_as_data"),
    ),
    "stopping": (("app/restart.py", "announcement"),),
    "started": (("starters/telemetry/status.py", "_values_before"),),
    "stopped": (
        ("starters/telemetry/status.py", "_values_before"),
        ("starters/telemetry/transitions.py", "_duration"),
    ),
    "unlocked": (("starters/commands/local_verbs.py", "act"),),
}
NOT_EVENTS = {"AlarmRecord", "Alarm", "_alarm"}  # they have code and severity too


@dataclass
class CodeInSource:
    """What the source says of one code; no severities: they are computed."""

    severities: set[str] = field(default_factory=set)
    fields: set[str] = field(default_factory=set)

    @property
    def is_severity_computed(self) -> bool:
        """Return whether no literal names the severity."""
        return not self.severities


def fields_made_for(code: str) -> set[str]:
    """Return the keys of every dictionary in the functions that make a code's data."""
    return {key for path, name in MADE_BY.get(code, ()) for key in _keys_in(path, name)}


def _keys_in(path: str, name: str) -> Iterator[str]:
    module = ast.parse((SOURCE / path).read_text("utf-8"))
    function = next(each for each in _functions(module) if getattr(each, "name", "") == name)
    for node in ast.walk(function):
        if isinstance(node, ast.Dict):
            yield from (key.value for key in node.keys if isinstance(key, ast.Constant))


class Source:
    """Every call of the source that has a code and a severity."""

    def __init__(self) -> None:
        self.found: dict[str, CodeInSource] = defaultdict(CodeInSource)
        self.unresolved: list[str] = []
        self._constants = dict(_constants())
        for path in sorted(SOURCE.rglob("*.py")):
            if "everity" not in (text := path.read_text("utf-8")):
                continue
            module = ast.parse(text)
            self._read(path.relative_to(SOURCE).as_posix(), module)

    def _read(self, name: str, module: ast.Module) -> None:
        for function in _functions(module):
            for call in _own_calls(function):
                if _callee(call) in NOT_EVENTS:
                    continue
                for place, severity, data in _coded(call):
                    self._take(name, module, function, place, severity, data)

    def _take(
        self,
        name: str,
        module: ast.Module,
        function: ast.AST,
        code: ast.expr,
        severity: ast.expr,
        data: ast.expr | None,
    ) -> None:
        codes = self._codes(name, module, function, code)
        if codes is None:
            self.unresolved.append(f"{name}:{code.lineno} {ast.unparse(code)}")
            return
        for each in codes:
            self.found[each].severities |= _severities(severity)
            self.found[each].fields |= _keys(function, data)

    def _codes(
        self, name: str, module: ast.Module, function: ast.AST, code: ast.expr
    ) -> tuple[str, ...] | None:
        """Return the codes that an expression may be; nothing for what only passes a parameter on."""
        text = ast.unparse(code)
        if (name, text) in ELSEWHERE:
            return ELSEWHERE[name, text]
        if isinstance(code, ast.JoinedStr):
            return (self._joined(code, name),)
        if found := _literals(code):
            return found
        if not isinstance(code, ast.Name):
            return () if text.startswith("change.") else None
        if assigned := [each for value in _assigned(function, text) for each in _literals(value)]:
            return tuple(assigned)
        if text in _parameters(function):
            return self._of_callers(module, function, text)
        constant = self._constants.get((name, text)) or self._imported(module, text)
        return None if constant is None else (constant,)

    def _of_callers(self, module: ast.Module, function: ast.AST, parameter: str) -> tuple[str, ...]:
        """Return what callers in the same module give for a parameter that is not before a severity there."""
        place = _parameters(function).index(parameter)
        found: list[str] = []
        for call in (node for node in ast.walk(module) if isinstance(node, ast.Call)):
            if _callee(call) == getattr(function, "name", "") and place < len(call.args):
                found += _literals(call.args[place])
        return tuple(found)

    def _imported(self, module: ast.Module, name: str) -> str | None:
        for node in ast.walk(module):
            if isinstance(node, ast.ImportFrom) and any(alias.name == name for alias in node.names):
                path = str(node.module).removeprefix("gateway.").replace(".", "/") + ".py"
                return self._constants.get((path, name))
        return None

    def _joined(self, code: ast.JoinedStr, name: str) -> str:
        parts = [
            str(part.value)
            if isinstance(part, ast.Constant)
            else self._constants[name, ast.unparse(part.value)]  # type: ignore[attr-defined]
            for part in code.values
        ]
        return "".join(parts)


def _constants() -> Iterator[tuple[tuple[str, str], str]]:
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant):
                for target in node.targets:
                    if isinstance(target, ast.Name):
                        yield (
                            (path.relative_to(SOURCE).as_posix(), target.id),
                            str(node.value.value),
                        )


def _functions(module: ast.Module) -> Iterator[ast.AST]:
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def _own_calls(function: ast.AST) -> Iterator[ast.Call]:
    """Give the calls in a function, but not those of functions inside it."""
    waiting = list(ast.iter_child_nodes(function))
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if isinstance(node, ast.Call):
            yield node
        waiting += ast.iter_child_nodes(node)


def _coded(call: ast.Call) -> Iterator[tuple[ast.expr, ast.expr, ast.expr | None]]:
    """Give code, severity and data of a call that has them."""
    named = {keyword.arg: keyword.value for keyword in call.keywords}
    if "code" in named and "severity" in named:
        yield named["code"], named["severity"], named.get("data")
    for place, (code, severity) in enumerate(zip(call.args, call.args[1:], strict=False)):
        if "severit" in ast.unparse(severity).lower():
            rest = call.args[place + 3 :]
            data = next((each for each in rest if isinstance(each, ast.Dict)), None)
            names = [each for each in rest if isinstance(each, ast.Name | ast.BinOp)]
            yield code, severity, data or named.get("data") or (names[-1] if names else None)


def _callee(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)


def _parameters(function: ast.AST) -> list[str]:
    if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
        return []
    names = [each.arg for each in (*function.args.posonlyargs, *function.args.args)]
    return names[1:] if names[:1] == ["self"] else names


def _literals(node: ast.expr) -> tuple[str, ...]:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return (node.value,)
    if isinstance(node, ast.IfExp):
        return (*_literals(node.body), *_literals(node.orelse))
    if isinstance(node, ast.Tuple) and node.elts:  # `code, more = ("locked", ..) if ..`
        return _literals(node.elts[0])
    return ()


def _assigned(function: ast.AST, name: str) -> Iterator[ast.expr]:
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                first = target.elts[0] if isinstance(target, ast.Tuple) else target
                if isinstance(first, ast.Name) and first.id == name:
                    yield node.value


def _severities(node: ast.expr) -> set[str]:
    return {each.lower() for each in SEVERITIES if f"Severity.{each}" in ast.unparse(node)}


def _keys(function: ast.AST, data: ast.expr | None) -> set[str]:
    """Return the keys of the data that can be read off the source."""
    if isinstance(data, ast.Dict):
        return {key.value for key in data.keys if isinstance(key, ast.Constant)}
    if isinstance(data, ast.BinOp):
        return _keys(function, data.left) | _keys(function, data.right)
    if isinstance(data, ast.Name):
        found: set[str] = set()
        for node in ast.walk(function):
            target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
            if isinstance(target, ast.Name) and target.id == data.id:
                found |= _keys(function, node.value) if isinstance(node.value, ast.Dict) else set()  # type: ignore[attr-defined]
        return found
    return set()
