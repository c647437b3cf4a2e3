"""Measures the size of the code, and writes docs/size.md: run it with `python -m tests.size_page`.

Sizes are counted in the tree, the ways by counting calls (`calls` and `command_way` of `tests.lab.bench`).
A code line is a line that is neither blank, docstring, comment nor import.
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests import words
from tests.lab.bench.calls import line_calls, publication_calls
from tests.lab.bench.command_way import start_command

ROOT = Path(__file__).parents[1]
CODE = ROOT / "gateway"
TESTS = ROOT / "tests"
PAGE = ROOT / "docs" / "size.md"
BEGIN, END = "<!-- sizes: made by python -m tests.size_page -->\n", "<!-- end of sizes -->\n"
SMALL = 60  # lines
MOST_ATTRIBUTES = 15
TOP = "(top)"
BUDGETS = {  # code lines; a room that is not named is to go
    "contract": 700,
    "modbus": 450,
    "families": 2650,
    "line": 2800,
    "starters": 3800,
    "store": 1000,
    "mqtt": 1800,
    "config": 1010,
    "app": 1300,
    "system": 600,
    TOP: 120,
    "plugins": 4850,
    "cli": 3500,
    "sim": 2500,
}
# Rooms that are to be imported by their `__init__` alone.
DOORS = ("config", "modbus", "contract", "starters", "store", "line", "mqtt", "families")
EMPTY = {getattr(tokenize, name) for name in ("NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER", "COMMENT")}
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)

Row = tuple[str, str, str]  # what, measured, to reach


def modules(folder: Path = CODE) -> list[Path]:
    """Return the modules below a folder, packages' `__init__` left out."""
    return sorted(path for path in folder.rglob("*.py") if path.stem != "__init__")


def room_of(path: Path) -> str:
    """Return the room that a module of the product lies in."""
    parts = path.relative_to(CODE).parts
    return parts[0] if len(parts) > 1 else TOP


def code_lines(path: Path) -> int:
    """Return how many code lines a module has."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(path.read_text("utf-8")).readline):
        if token.type not in EMPTY:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            lines.difference_update(range(node.lineno, node.end_lineno + 1))
        elif isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            lines.difference_update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


def room_sizes() -> Counter[str]:
    """Return the code lines of each room."""
    sizes: Counter[str] = Counter()
    for path in CODE.rglob("*.py"):
        sizes[room_of(path)] += code_lines(path)
    return sizes


def largest_folder() -> tuple[int, list[str]]:
    """Return how many modules the largest folders hold, and which folders these are."""
    sizes = Counter(path.parent for path in modules())
    most = max(sizes.values())
    return most, sorted(str(each.relative_to(ROOT)) for each, size in sizes.items() if size == most)


def small_files() -> list[str]:
    """Return the modules below SMALL lines."""
    return [str(path.relative_to(CODE)) for path in modules() if _lines(path) < SMALL]


def classes() -> Iterator[ast.ClassDef]:
    """Give every class of the product."""
    for path in modules():
        yield from (each for each in ast.walk(_tree(path)) if isinstance(each, ast.ClassDef))


def double_names() -> list[str]:
    """Return the names that more than one class has."""
    names = Counter(each.name for each in classes())
    return sorted(name for name, number in names.items() if number > 1)


def attributes(node: ast.ClassDef) -> int:
    """Return how many attributes a class sets on itself."""
    names = {
        target.attr
        for each in ast.walk(node)
        if isinstance(each, ast.Assign | ast.AnnAssign)
        for target in (each.targets if isinstance(each, ast.Assign) else [each.target])
        if isinstance(target, ast.Attribute) and ast.unparse(target.value) == "self"
    }
    decorators = [ast.unparse(each) for each in node.decorator_list]
    if any("dataclass" in each and "frozen" not in each for each in decorators):
        names |= {ast.unparse(each.target) for each in node.body if isinstance(each, ast.AnnAssign)}
    return len(names)


def fat_classes() -> list[tuple[int, str]]:
    """Return the classes with too many attributes, the largest first."""
    found = [(attributes(each), each.name) for each in classes()]
    return sorted((each for each in found if each[0] > MOST_ATTRIBUTES), reverse=True)


def imports_across_rooms() -> dict[str, tuple[int, int]]:
    """Return for each room with a front door how often others import it by that, and how often past it."""
    found = dict.fromkeys(DOORS, (0, 0))
    for path in CODE.rglob("*.py"):
        for node in _imports(path):
            top, _, module = str(node.module).partition(".")
            room, _, inner = module.partition(".")
            if top == "gateway" and room in found and room != room_of(path):
                front, past = found[room]
                found[room] = (front + (not inner), past + bool(inner))
    return found


def door_names(room: str) -> list[str]:
    """Return the names that a room's front door gives."""
    imports = _imports(CODE / room / "__init__.py")
    return [alias.asname or alias.name for node in imports for alias in node.names]


def internal_constructions() -> Counter[str]:
    """Return how often the tests construct each class of the product that a module of theirs imports."""
    own = {each.name for each in classes()}
    found: Counter[str] = Counter()
    for path in TESTS.rglob("*.py"):
        names = {
            alias.asname or alias.name: f"{node.module}.{alias.name}"
            for node in _imports(path)
            if str(node.module).split(".")[0] == "gateway"
            for alias in node.names
            if alias.name in own
        }
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in names:
                found[names[node.func.id]] += 1
    return found


def room_rows() -> list[Row]:
    """Return the code lines of each room beside their budget."""
    sizes = room_sizes()
    rooms = [*BUDGETS, *sorted(set(sizes) - set(BUDGETS))]
    rows = [(f"`{room}`", f"{sizes[room]:,}", f"{BUDGETS.get(room, 0):,}") for room in rooms]
    return [*rows, ("all", f"{sum(sizes.values()):,}", f"{sum(BUDGETS.values()):,}")]


def size_rows() -> list[Row]:
    """Return what else is counted in the tree."""
    most, folders = largest_folder()
    fat = fat_classes()
    doors = imports_across_rooms()
    built = internal_constructions()
    past = ", ".join(f"{door} {past}" for door, (_, past) in doors.items() if past)
    return [
        ("classes", str(sum(1 for _ in classes())), "450"),
        (
            f"classes with more than {MOST_ATTRIBUTES} attributes",
            _first([f"{n} {name}" for n, name in fat]),
            "0",
        ),
        ("imports past a front door", f"{sum(past for _, past in doors.values())} ({past})", "0"),
        ("modules of the largest folder", f"{most} ({', '.join(folders)})", "13"),
        (f"files below {SMALL} lines", str(len(small_files())), "under 30"),
        ("class names that exist twice", str(len(double_names())), "0"),
        ("places with a word that `tests/words.py` lists", str(len(words.found())), "0"),
        ("lines of tests", f"{sum(_lines(path) for path in TESTS.rglob('*.py')):,}", "48,000"),
        ("constructions of internal classes in tests", f"{built.total():,} of {len(built)}", "under 1,500"),
    ]


def way_rows() -> list[Row]:
    """Return how many files and calls the two ways take; some seconds."""
    publication = publication_calls()
    command = start_command()
    line, _ = line_calls()
    up = f"{len(publication.files)}; {publication.calls}"
    return [
        ("files and calls from the reply to the publication", up, "22; 450"),
        ("files of a start command, from its message to its result", str(len(command.files)), "35"),
        ("calls on the lines' thread for each transaction, 8 starters", f"{line:.0f}", "130"),
    ]


def table(rows: list[Row], *, last: str = "to reach") -> str:
    """Return rows as Markdown."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([f"| what | measured | {last} |", "|---|---|---|", *lines, ""])


def main() -> None:
    """Write the sizes between the two marks of the page."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    text = f"{table(room_rows(), last='budget')}\n{table(size_rows() + way_rows())}"
    PAGE.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.partition(END)[2]}", "utf-8")


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def _imports(path: Path) -> Iterator[ast.ImportFrom]:
    return (node for node in ast.walk(_tree(path)) if isinstance(node, ast.ImportFrom))


def _lines(path: Path) -> int:
    return len(path.read_text("utf-8").splitlines())


def _first(found: list[str]) -> str:
    return f"{len(found)}: {', '.join(found[:6])}" if found else "0"


if __name__ == "__main__":
    main()
