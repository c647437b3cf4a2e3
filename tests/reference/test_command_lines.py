"""Every command line of this program that a document or a text of the program shows can be typed."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path

import pytest

from gateway.cli.main import COMMANDS, _parse, _parser
from tests.reference.commands_page import parsers

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    *(path for path in ROOT.glob("*.md") if path.name != "CHANGELOG.md"),
    *(ROOT / "docs").rglob("*.md"),
    *(ROOT / "deploy").rglob("*"),
]
FENCE = re.compile(r"^```(?:\w*)[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
LINE = re.compile(r"^(?:\$ |│ \$ |sudo )*(?:\S*/)?starter-gateway (.+?)(?:\s*│)?$")
SHOWN = re.compile(r"(?<![\w/.-])starter-gateway ([a-z][a-z-]*)((?: +--[a-z-]+)*)")


def documents() -> list[Path]:
    return [path for path in DOCUMENTS if path.is_file() and path.suffix in ("", ".md", ".sh", ".service")]


def typed() -> list[str]:
    """Return the lines of the documents' blocks that begin with the program."""
    found = []
    for path in documents():
        for block in FENCE.findall(path.read_text("utf-8")):
            for line in block.replace("\\\n", " ").splitlines():
                match = LINE.match(line)
                if match and not match[1].startswith("["):
                    found.append(match[1])
    return found


def spans() -> list[tuple[str, str]]:
    """Return command and options of what stands in code spans, and in texts of the program."""
    texts = [
        span
        for path in documents()
        if path.suffix == ".md"
        for span in re.findall(r"`([^`\n]+)`", FENCE.sub("", path.read_text("utf-8")))
    ]
    for source in (path.read_text("utf-8") for path in sorted((ROOT / "gateway").rglob("*.py"))):
        nodes = ast.walk(ast.parse(source)) if "starter-gateway" in source else ()
        for node in nodes:
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts += re.findall(r"`([^`\n]+)`", node.value)
    return [(match[1], match[2]) for text in texts for match in SHOWN.finditer(text)]


@pytest.mark.parametrize("line", sorted(set(typed())))
def test_a_line_of_a_document_can_be_typed(line: str) -> None:
    line = re.sub(r"\s+#.*$", "", line).partition(" | ")[0].partition(" > ")[0].partition(" & ")[0].strip()
    words = shlex.split(line)
    if ".." in line or "[" in line or words == ["COMMAND"]:
        assert words[0] in COMMANDS or words[0] == "COMMAND"  # a synopsis
        return

    assert _parse(_parser(words[0]), words).command == words[0]


@pytest.mark.parametrize(("command", "options"), sorted(set(spans())))
def test_a_command_that_a_text_names_exists(command: str, options: str) -> None:
    assert command in COMMANDS
    known = {
        option
        for name, parser in parsers().items()
        if name.split()[0] == command
        for action in parser._actions
        for option in action.option_strings
    }
    assert set(options.split()) <= known


def test_lines_and_names_were_found() -> None:
    assert len(set(typed())) > 10
    assert len(set(spans())) > 5
