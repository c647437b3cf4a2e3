"""`check` and `run` agree on every configuration: what the one refuses the other does not begin with."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from gateway.cli import run as run_command
from gateway.cli.main import main

EXAMPLES = sorted(Path("config").glob("*.toml"))
ROUNDS = 60
TOKENS = ["", "0", "-1", "1e9", "true", '"x"', "[]", "{}", '"8n1"', "ssw06", '"sst"', "1.5", "inf", "#", "\\"]
SWAPS = [('"', "'"), ("1", "300"), ("ssw07", "ssw08"), ("=", "")]


def damaged(text: str, dice: random.Random) -> str:
    """Return a configuration with one to three lines changed, doubled, swapped or left out."""
    lines = text.splitlines()
    for _ in range(dice.randint(1, 3)):
        at = dice.randrange(len(lines))
        key, equals, _ = lines[at].partition("=")
        other = dice.randrange(len(lines))
        match dice.randrange(6):
            case 0:
                del lines[at]
            case 1:
                lines.insert(at, lines[at])
            case 2:
                lines[at], lines[other] = lines[other], lines[at]
            case 3 if key in ("port ", "state_dir "):
                pass
            case 3 | 4 if equals:
                lines[at] = f"{key}={dice.choice(TOKENS)}"
            case _:
                lines[at] = lines[at].replace(*dice.choice(SWAPS))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_both_end_alike_for_a_configuration_and_for_what_becomes_of_it_by_mistakes(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def serve(path: Path, site: Any, **_: Any) -> None:
        pass  # everything before it is what is compared

    monkeypatch.setattr(run_command, "serve_site", serve)
    monkeypatch.setenv("STARTER_GATEWAY_MQTT_PASSWORD", "secret")
    monkeypatch.setattr("faulthandler.enable", lambda: None)  # pytest has its own
    monkeypatch.setattr(run_command, "log_to_stderr", lambda **_: None)
    monkeypatch.chdir(tmp_path)
    text = with_state_in(tmp_path, (Path(__file__).parents[2] / example).read_text(encoding="utf-8"))
    dice, seen = random.Random(example.name), set()
    for number in range(ROUNDS):
        path = tmp_path / "site.toml"
        path.write_text(damaged(text, dice) if number else text, encoding="utf-8")

        codes = main(["check", str(path)]), main(["run", str(path)])

        printed = capsys.readouterr().err
        assert codes[0] == codes[1], (path.read_text(encoding="utf-8"), printed)
        assert codes[0] in (0, 78), printed
        assert "Traceback" not in printed
        seen.add(codes[0])
    assert 78 in seen


def with_state_in(folder: Path, text: str) -> str:
    """Return a configuration whose state is stored in a folder of the test."""
    stored = [line for line in text.splitlines() if not line.startswith("state_dir")]
    at = stored.index("[gateway]") + 1
    return "\n".join([*stored[:at], f'state_dir = "{folder / "state"}"', *stored[at:]])
