"""The generated pages are what the program says, and leave nothing unexplained."""

from __future__ import annotations

import pytest

from gateway.cli.main import COMMANDS
from gateway.config.reading import parse
from gateway.config.schema import TABLES
from tests.reference.commands_page import page, parsers, unexplained
from tests.reference.configuration_page import tables
from tests.reference.examples import tutorial_commands, tutorial_config
from tests.reference.pages import FOLDER, NAMES, made, with_part


@pytest.mark.parametrize("name", NAMES)
def test_a_generated_page_is_what_the_program_says(name: str) -> None:
    assert (FOLDER / name).read_text("utf-8") == made(name)  # else: make docs


def test_a_page_without_its_marks_is_refused_rather_than_overwritten() -> None:
    with pytest.raises(ValueError, match="lost its mark"):
        with_part("# all by hand\n", "<!-- rows -->\n", "", "")


def test_every_command_and_every_argument_is_on_the_page_and_explained() -> None:
    assert unexplained() == []  # else: description= or help= in its add_arguments
    assert set(COMMANDS) <= set(parsers())
    assert [name for name in parsers() if f"## {name}\n" not in page()] == []


def test_every_table_and_every_key_has_a_description_and_a_time_its_unit() -> None:
    keys = [(table.header, key) for table in tables() for key in table.keys]

    assert {table.header.strip("[]") for table in tables()} == set(TABLES) - {""}
    assert [table.header for table in tables() if not table.meaning] == []
    assert [(header, key.name) for header, key in keys if not key.meaning.endswith((".", ")"))] == []
    assert {key.unit for _, key in keys if key.name.endswith("_s")} == {"s"}


def test_the_tutorial_configures_two_pumps_and_starts_no_motor_before_a_stop_was_confirmed() -> None:
    config = parse(tutorial_config(), "site.toml")
    sent = [line.split()[4] for line in tutorial_commands() if line.startswith("starter-gateway send")]

    assert [starter.name for starter in config.lines[0].starters] == ["pump-1", "pump-2"]
    assert (sent[:2], sent[-1]) == (["stop", "start"], "stop")
