"""`check --upgrade`: whether this version may replace the one that runs, by its exit code."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from tests.config.sites import SITE

KNOWN = {"starters": {"pump-1": {"rows": {"P314": [5], "P313": [1]}, "written": {}}}}  # s, action


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "state").mkdir()
    path = tmp_path / "site.toml"
    path.write_text(SITE.replace('name = "mcc1"', 'name = "mcc1"\nstate_dir = "state"'))
    return path


@pytest.fixture
def running(config: Path) -> Iterator[None]:
    with (config.parent / "state" / "gateway.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def write(config: Path, name: str, document: dict[str, Any]) -> None:
    (config.parent / "state" / name).write_text(json.dumps(document))


def test_what_is_accepted_and_interrupts_nothing_is_0(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(config.parent.rglob("*"))

    assert main(["check", str(config), "--upgrade"]) == 0

    assert "no gateway runs with this state_dir" in capsys.readouterr().out
    assert sorted(config.parent.rglob("*")) == before


def test_where_this_user_may_not_look_nothing_is_accepted(
    config: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(path: Path) -> list[str]:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "listdir", refuse)

    assert main(["check", str(config), "--upgrade"]) == 1

    done = capsys.readouterr()
    assert "this user may not look into it (run this as the gateway's user, or as root)" in done.err
    assert done.out == ""


def test_a_lock_that_this_user_may_not_see_counts_as_that_of_a_gateway_that_runs(
    config: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(config, "watchdogs.json", KNOWN)
    lock, opened = config.parent / "state" / "gateway.lock", os.open

    def refuse(path: Path, *rest: int) -> int:
        if path == lock:
            raise PermissionError(13, "Permission denied", str(path))
        return opened(path, *rest)

    monkeypatch.setattr(os, "open", refuse)

    assert main(["check", str(config), "--upgrade"]) == 75
    assert "no gateway runs" not in capsys.readouterr().out


@pytest.mark.usefixtures("running")
def test_a_watchdog_that_a_restart_would_trip_is_75_with_what_to_do(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(config, "watchdogs.json", KNOWN)

    assert main(["check", str(config), "--upgrade"]) == 75

    out = capsys.readouterr().out
    assert "pump-1: a restart may leave it without a request for " in out
    assert " s at the worst; its watchdog of 5 s is " in out
    assert "stop these motors first, or make their watchdogs longer" in out
    assert "pump-2" not in out
    assert main(["check", str(config), "--upgrade", "--json"]) == 75
    found = json.loads(capsys.readouterr().out)
    assert found["is_restart_safe"] is False
    assert [each["is_safe"] for each in found["starters"]] == [False, True]


@pytest.mark.usefixtures("running")
def test_a_restart_is_safe_for_a_watchdog_that_is_long_enough(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(
        config,
        "watchdogs.json",
        {"starters": {"pump-1": {"rows": {"P314": [60], "P313": [1]}, "written": {}}}},
    )

    code = main(["check", str(config), "--upgrade"])

    assert (code, capsys.readouterr().out.splitlines()[-1][:20]) == (0, "a restart is safe: n")


@pytest.mark.usefixtures("running")
def test_a_watchdog_in_the_configuration_counts_as_well(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config.write_text(config.read_text().replace("every_s = 2.0", "every_s = 2.0\nwatchdog_s = 7"))

    assert main(["check", str(config), "--upgrade"]) == 75
    assert "pump-2: a restart may" in capsys.readouterr().out


def test_a_state_of_a_later_version_is_78_and_stays_as_it_is(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(config, "watchdogs.json", {"version": 9})

    assert main(["check", str(config), "--upgrade"]) == 78

    assert "watchdogs.json has format 9" in capsys.readouterr().err
    assert [path.name for path in (config.parent / "state").iterdir()] == ["watchdogs.json"]


def test_a_configuration_that_is_refused_is_78(config: Path) -> None:
    config.write_text(config.read_text() + "\n[nonsense]\n")

    assert main(["check", str(config), "--upgrade"]) == 78
