from __future__ import annotations

from gateway.config.reading import parse
from tests.reference.tutorial import file, runnable


def test_the_tutorials_configuration_is_right() -> None:
    config = parse(file("site.toml"), "site.toml")

    assert [starter.name for starter in config.lines[0].starters] == ["pump-1", "pump-2"]


def test_no_motor_is_started_before_a_stop_was_confirmed() -> None:
    sent = [line.split()[4] for line in runnable() if line.startswith("starter-gateway send")]

    assert sent[:2] == ["stop", "start"]
    assert sent[-1] == "stop"
