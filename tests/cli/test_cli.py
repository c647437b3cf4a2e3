"""The command line itself, and the commands that need nothing else: `docs`, `web-password`."""

from __future__ import annotations

import argparse
import io
import re
import subprocess
import sys
import threading
import tomllib
from pathlib import Path
from urllib.request import urlopen

import pytest

from gateway.cli import docs
from gateway.cli.broker import password_of
from gateway.cli.command import Progress, in_words
from gateway.cli.main import COMMANDS, EXAMPLES, main, whole_parser
from gateway.system.password_hash import is_password
from tests.cli.backup_site import BackupSite
from tests.rig import run_cli


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_help_whose_example_is_a_right_use(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0

    said = capsys.readouterr().out
    assert f"usage: starter-gateway {command}" in said
    if command in EXAMPLES:
        assert "example: starter-gateway" in said
        assert whole_parser().parse_args(EXAMPLES[command].split()).command == command


def test_a_shell_completes_starters_and_their_verbs(place: BackupSite) -> None:
    (choices,) = [a.choices for a in whole_parser()._actions if isinstance(a, argparse._SubParsersAction)]
    known = {action.dest: action for action in choices["send"]._actions}
    starter, verb = (known[name].completer for name in ("starter", "verb"))

    typed = argparse.Namespace(config=str(place.config), starter="pump")
    assert [*starter(parsed_args=typed, prefix="")] == ["pump", "mill"]
    assert {"start", "stop", "lock"} <= {*verb(parsed_args=typed, prefix="")}


def test_without_an_output_a_command_ends_as_with_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout", None)  # as after >&-

    assert main(["encode", "ssw07", "1", "start"]) == 0


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


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_one_line_changes_and_is_taken_away_at_the_end() -> None:
    terminal = Terminal()
    progress = Progress(terminal)

    progress.show(0.1, "one")
    progress.show(0.2, "two")
    progress.say("found")
    progress.clear()

    said = terminal.getvalue()
    assert said.count("\n") == 1
    assert said.endswith("\r\x1b[Kfound\n\r\x1b[K")
    assert re.search(r" 10% one, \d\.\d s left\r", said)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.0 s"),
        (-1, "0.0 s"),
        (9.94, "9.9 s"),
        (38.2, "38 s"),
        (200, "3 min 20 s"),
        (3900, "1 h 5 min"),
    ],
)
def test_durations_are_written_in_words(seconds: float, text: str) -> None:
    assert in_words(seconds) == text


@pytest.mark.parametrize(
    ("entered", "is_typed", "code", "said"),
    [
        (["correct horse"], False, 0, 'password = "'),
        (["correct horse"] * 2, True, 0, 'password = "'),
        (["correct horse", "correct hors"], True, 2, "differ"),
        (["short"], False, 2, "at least 8"),
        (["x" * 2000], False, 2, "1 to 1024 bytes"),
    ],
)
def test_a_password_for_the_page_is_piped_or_typed_twice(
    monkeypatch: pytest.MonkeyPatch, entered: list[str], *, is_typed: bool, code: int, said: str
) -> None:
    answers = iter(entered)
    monkeypatch.setattr(sys, "stdin", Terminal() if is_typed else io.StringIO(f"{entered[0]}\n"))
    monkeypatch.setattr("getpass.getpass", lambda _: next(answers))

    ran = run_cli("web-password")

    assert (ran.code, said in ran.out + ran.err) == (code, True)
    assert code or is_password("correct horse", tomllib.loads(ran.out)["password"])


def test_the_documentation_is_served_on_loopback_or_it_is_said_why_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(docs, "SITE", tmp_path)
    missing = run_cli("docs")
    (tmp_path / "index.html").write_text("<h1>Starter Gateway</h1>", "utf-8")
    server = docs.server_of(0)
    serving = threading.Thread(target=server.serve_forever)
    serving.start()
    try:
        with urlopen(f"http://127.0.0.1:{server.server_port}/") as answer:
            assert b"Starter Gateway" in answer.read()
        in_use = run_cli("docs", "--port", str(server.server_port))
    finally:
        server.shutdown()
        serving.join()
        server.server_close()

    assert server.server_address[0] == "127.0.0.1"
    assert (missing.code, "make site" in missing.err) == (1, True)
    assert in_use.code == 1
    assert re.search(rf"127\.0\.0\.1:{server.server_port}.*take another --port", in_use.err)
