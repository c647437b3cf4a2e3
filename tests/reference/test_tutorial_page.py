from __future__ import annotations

import pytest

from gateway.cli.main import _parse, _parser
from gateway.config.load import parse
from tests.reference.tutorial import ROOT, commands, file, runnable, shipped_files

PROGRAM = "starter-gateway "
OURS = [line for line in commands() if line.removeprefix("sudo ").startswith(PROGRAM)]


@pytest.mark.parametrize("name", shipped_files())
def test_what_the_tutorial_installs_is_here(name: str) -> None:
    assert (ROOT / name).is_file()


@pytest.mark.parametrize("line", OURS)
def test_the_program_takes_the_tutorials_command_lines(line: str) -> None:
    words = line.removeprefix(PROGRAM).split()

    assert _parse(_parser(words[0]), words).command == words[0]


def test_the_tutorials_configuration_is_right() -> None:
    config = parse(file("site.toml"), "site.toml")

    assert [starter.name for starter in config.lines[0].starters] == ["pump-1", "pump-2"]


def test_no_motor_is_started_before_a_stop_was_confirmed() -> None:
    sent = [line.split()[4] for line in runnable() if line.startswith(f"{PROGRAM}send")]

    assert sent[:2] == ["stop", "start"]
    assert sent[-1] == "stop"
