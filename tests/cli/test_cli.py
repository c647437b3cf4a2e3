from __future__ import annotations

import subprocess
import sys

import pytest

from gateway.cli.main import COMMANDS, main


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_own_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0

    assert f"starter-gateway {command}" in capsys.readouterr().out


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
