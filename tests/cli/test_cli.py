from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.cli.broker import password_of
from gateway.cli.main import COMMANDS, EXAMPLES, main, whole_parser


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_own_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0

    assert f"starter-gateway {command}" in capsys.readouterr().out


@pytest.mark.parametrize("command", EXAMPLES)
def test_the_example_of_a_help_is_a_right_use(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = EXAMPLES[command].split()

    args = whole_parser().parse_args(words)

    assert args.command == words[0] == command
    assert main([command, "--help"]) == 0
    assert "example: starter-gateway" in capsys.readouterr().out


def test_a_shell_completes_starters_and_their_verbs(site: Path) -> None:
    send = commands()["send"]
    starter, verb = (
        next(a for a in send._actions if a.dest == name).completer for name in ("starter", "verb")
    )

    typed = argparse.Namespace(config=str(site), starter="pump")
    assert [*starter(parsed_args=typed, prefix="")] == ["pump", "mill"]
    assert {"start", "stop", "lock"} <= {*verb(parsed_args=typed, prefix="")}


def commands() -> dict[str, argparse.ArgumentParser]:
    (choices,) = [a.choices for a in whole_parser()._actions if isinstance(a, argparse._SubParsersAction)]
    return dict(choices)


def test_a_password_is_of_the_environment_else_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("getpass.getpass", lambda prompt: f"typed at {prompt!r}")

    assert password_of("alice", "b", password_file=None) == "typed at 'Password of alice at b: '"
    monkeypatch.setenv("STARTER_GATEWAY_MQTT_PASSWORD", "a")
    assert password_of("alice", "b", password_file=None) == "a"


def test_only_the_chosen_command_is_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    for command in COMMANDS:
        monkeypatch.delitem(sys.modules, f"gateway.cli.{command}", raising=False)

    main(["schema"])

    loaded = [command for command in COMMANDS if f"gateway.cli.{command}" in sys.modules]
    assert loaded == ["schema"]


def test_an_interrupted_command_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gateway.cli.schema.json.dumps", interrupt)

    assert main(["schema"]) == 1


def test_a_reader_who_has_had_enough_draws_no_traceback() -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "gateway", "schema"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()

        assert process.stderr.read() == b""
        assert process.wait(30.0) == 1
