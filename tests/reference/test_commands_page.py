from __future__ import annotations

from gateway.cli.main import COMMANDS
from tests.reference.commands_page import page, parsers, unexplained


def test_every_command_and_every_argument_is_explained() -> None:
    assert unexplained() == []  # else: description= or help= in its add_arguments


def test_the_page_has_every_command() -> None:
    made = page()

    assert set(COMMANDS) <= set(parsers())
    assert [name for name in parsers() if f"## {name}\n" not in made] == []
