from __future__ import annotations

import argparse
import subprocess
import sys
import types
from pathlib import Path

import pytest

from gateway import __version__
from gateway.cli.main import COMMANDS, main
from tests.config.sites import changed


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0

    assert capsys.readouterr().out == f"starter-gateway {__version__}\n"


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0

    out = capsys.readouterr().out
    assert all(f"    {command} " in out for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_own_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0

    assert f"starter-gateway {command}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "COMMAND"),
        (["chekc"], "'chekc'"),  # codespell:ignore
        (["check"], "CONFIG"),
        (["check", "a.toml", "--fast"], "--fast"),
        (["check", "a.toml", "b.toml"], "b.toml"),
        (["encode", "ssw07", "1", "start", "--slow"], "--slow"),
        (["decode", "ssw7", "holding", "0", "1"], "'ssw7'"),
    ],
)
def test_a_wrong_word_is_reported_in_one_line_and_is_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2

    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("starter-gateway: ")
    assert captured.err.count("\n") == 1
    assert words in captured.err


@pytest.mark.parametrize("command", ["check", "run", "simulate"])
def test_a_wrong_configuration_is_reported_line_by_line_and_is_78(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "site.toml"
    path.write_text(changed(('name = "mcc1"', 'name = ""'), ("address = 2", "address = 1")), "utf-8")

    assert main([command, str(path)]) == 78

    first, second = capsys.readouterr().err.splitlines()
    assert first == f"starter-gateway: {path}: line 2: gateway.name: is '' (only a-z, 0-9, _ and -)"
    assert second.startswith(f"starter-gateway: {path}: line 20: line[0].starter[1].address: ")


def test_a_command_that_cannot_be_carried_out_is_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["encode", "ssw07", "1", "set", "parameter=P314", "value=5000"]) == 1

    assert capsys.readouterr().err.count("\n") == 1


def test_only_the_chosen_command_is_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    for command in COMMANDS:
        monkeypatch.delitem(sys.modules, f"gateway.cli.{command}", raising=False)

    main(["schema"])

    loaded = [command for command in COMMANDS if f"gateway.cli.{command}" in sys.modules]
    assert loaded == ["schema"]


def test_arguments_may_follow_an_option(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["encode", "ssw900", "5", "set", "--slot", "1", "parameter=C8.2.5.3", "value=5"]

    assert main(arguments) == 0

    assert capsys.readouterr().out == "05 06 02 DE 00 32 68 19\n"


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


def test_completion_is_left_to_argcomplete(monkeypatch: pytest.MonkeyPatch) -> None:
    completed: list[argparse.ArgumentParser] = []
    fake = types.ModuleType("argcomplete")
    fake.autocomplete = completed.append  # type: ignore[attr-defined]  # a module of our own making
    monkeypatch.setitem(sys.modules, "argcomplete", fake)
    monkeypatch.setenv("_ARGCOMPLETE", "1")

    main([])

    (parser,) = completed
    assert parser.parse_args(["encode", "ssw07", "1", "start"]).last_word is None  # it knows every command's
    assert parser.parse_args(["check", "site.toml"]).json is False


def test_without_argcomplete_there_is_no_completion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "argcomplete", None)
    monkeypatch.setenv("_ARGCOMPLETE", "1")

    assert main([]) == 2


def test_without_arguments_those_of_the_process_count(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["starter-gateway", "encode", "ssw07", "1", "start"])

    assert main() == 0

    assert capsys.readouterr().out == "01 05 00 64 FF 00 CD E5\n"
