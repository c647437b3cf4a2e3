"""Measures the size of the code, and writes docs/size.md: run it with `python -m tests.size_page`.

Sizes are counted in the tree, the ways by counting calls (`tests.bench.calls`, `tests.bench.command_way`).
Speed is not measured here: docs/performance.md has it.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests import words
from tests.bench.calls import line_calls, publication_calls
from tests.bench.command_way import start_command
from tests.virtual_time import run_virtually

ROOT = Path(__file__).parents[1]
CODE = ROOT / "gateway"
PAGE = ROOT / "docs" / "size.md"
BEGIN, END = "<!-- sizes: made by python -m tests.size_page -->\n", "<!-- end of sizes -->\n"
SMALL = 60  # lines
SCHEDULER = CODE / "line" / "scheduler"

Row = tuple[str, str, str]  # what, measured, to reach


def modules(folder: Path = CODE) -> list[Path]:
    """Return the modules below a folder, packages' `__init__` left out."""
    return sorted(path for path in folder.rglob("*.py") if path.stem != "__init__")


def lines_of(path: Path) -> int:
    """Return how many lines a file has."""
    return len(path.read_text("utf-8").splitlines())


def largest_folder() -> tuple[int, list[str]]:
    """Return how many modules the largest folders hold, and which folders these are."""
    sizes = Counter(path.parent for path in modules())
    most = max(sizes.values())
    return most, sorted(str(each.relative_to(ROOT)) for each, size in sizes.items() if size == most)


def small_files() -> list[str]:
    """Return the modules below SMALL lines."""
    return [str(path.relative_to(CODE)) for path in modules() if lines_of(path) < SMALL]


def classes(folder: Path = CODE) -> Iterator[ast.ClassDef]:
    """Give every class that is defined below a folder."""
    for path in modules(folder):
        yield from (each for each in ast.walk(_tree(path)) if isinstance(each, ast.ClassDef))


def double_names() -> list[str]:
    """Return the names that more than one class has."""
    names = Counter(each.name for each in classes())
    return sorted(name for name, number in names.items() if number > 1)


def lines_without_simulator() -> int:
    """Return the lines of everything in gateway/ but sim/."""
    return sum(lines_of(path) for path in CODE.rglob("*.py") if CODE / "sim" not in path.parents)


def scheduler_constants() -> list[str]:
    """Return the numbers that the scheduler's modules name at their top."""
    found = []
    for path in modules(SCHEDULER):
        for node in _tree(path).body:
            targets = node.targets if isinstance(node, ast.Assign) else []
            found += [each.id for each in targets if isinstance(each, ast.Name) and _is_number(node)]
    return found


def poll_fields() -> list[str]:
    """Return the fields of a scheduled poll, those of its base class included."""
    by_name = {each.name: each for each in classes(SCHEDULER)}
    found, name = [], "ScheduledPoll"
    while name in by_name:
        each = by_name[name]
        found += [
            n.target.id for n in each.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)
        ]
        name = each.bases[0].id if each.bases and isinstance(each.bases[0], ast.Name) else ""
    return found


def size_rows() -> list[Row]:
    """Return what is counted in the tree."""
    most, folders = largest_folder()
    scheduler = sum(lines_of(path) for path in modules(SCHEDULER))
    parts = f"{scheduler}; {len(scheduler_constants())}; {len(poll_fields())}"
    return [
        ("modules of the largest folder", f"{most} ({', '.join(folders)})", "13"),
        (f"files below {SMALL} lines", str(len(small_files())), "under 30"),
        ("class names that exist twice", str(len(double_names())), "0"),
        ("lines of `gateway/` without `sim/`", f"{lines_without_simulator():,}", "23,000"),
        ("`line/scheduler`: lines; constants; fields of a scheduled poll", parts, "750; 20; 8"),
        ("places with a word that `tests/words.py` lists", str(sum(words.counts().values())), "0"),
    ]


def way_rows() -> list[Row]:
    """Return how many files and calls the two ways take; some seconds."""
    publication = publication_calls()
    command = run_virtually(start_command())
    line, _ = line_calls()
    up = f"{len(publication.files)}; {publication.calls}"
    return [
        ("files and calls from the reply to the publication", up, "30; 450"),
        ("files of a start command, from its message to its result", str(len(command.calls)), "55"),
        ("calls on the lines' thread for each transaction, 8 starters", f"{line:.0f}", "130"),
    ]


def table(rows: list[Row]) -> str:
    """Return rows as Markdown."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join(["| what | measured | to reach |", "|---|---|---|", *lines, ""])


def main() -> None:
    """Write the page."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n{table(size_rows() + way_rows())}\n{END}{after}", "utf-8")


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def _is_number(node: ast.Assign) -> bool:
    """Return whether a value is computed from numbers alone."""
    parts = (ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop, ast.Constant)
    return all(
        isinstance(each, parts) and isinstance(getattr(each, "value", 0), int | float)
        for each in ast.walk(node.value)
    )


if __name__ == "__main__":
    main()
