"""`starter-gateway web-password`."""

from __future__ import annotations

import io
import sys
import tomllib

import pytest

from gateway.cli.main import main
from gateway.system.password_hash import is_password


def test_the_line_of_a_password_from_standard_input_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\n"))

    assert main(["web-password"]) == 0

    assert is_password("correct horse", tomllib.loads(capsys.readouterr().out)["password"])


@pytest.mark.parametrize(("entered", "found"), [("short\n", "at least 8"), ("x" * 2000, "1 to 1024 bytes")])
def test_a_password_that_cannot_be_used_is_refused(
    entered: str, found: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(entered))

    assert main(["web-password"]) == 2

    assert found in capsys.readouterr().err


def test_at_a_terminal_it_is_asked_for_twice(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    answers = iter(["correct horse", "correct hors", "correct horse", "correct horse"])
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr("getpass.getpass", lambda _: next(answers))

    assert main(["web-password"]) == 2
    assert "differ" in capsys.readouterr().err
    assert main(["web-password"]) == 0
    assert is_password("correct horse", tomllib.loads(capsys.readouterr().out)["password"])
