from __future__ import annotations

from pathlib import Path

from gateway.cli.main import COMMANDS
from tests.reference.commands_page import page, parsers, unexplained


def test_every_command_and_every_argument_is_explained() -> None:
    assert unexplained() == []  # else: description= or help= in its add_arguments


def test_the_page_has_every_command() -> None:
    made = page()

    assert set(COMMANDS) <= set(parsers())
    assert [name for name in parsers() if f"## {name}\n" not in made] == []


def test_the_readme_names_every_command() -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text("utf-8")

    assert [name for name in COMMANDS if f"| `{name}" not in readme] == []
    assert len(readme.splitlines()) <= 220
