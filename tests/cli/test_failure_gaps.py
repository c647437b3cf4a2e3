"""`check` says what a crash and a hang mean for each starter's watchdog, and which setting helps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gateway.cli.main import main
from gateway.line.capacity.outage import Restart
from tests.config.sites import changed

SERVICE = Path(__file__).parents[2] / "deploy" / "starter-gateway.service"


def check(folder: Path, watchdog: str, capsys: pytest.CaptureFixture[str], *options: str) -> str:
    (folder / "site.toml").write_text(changed(("every_s = 2.0", f"every_s = 2.0\n{watchdog}")), "utf-8")
    assert main(["check", str(folder / "site.toml"), *options]) == 0
    return capsys.readouterr().out


def warnings(out: str) -> list[str]:
    return [line.removeprefix("warning: ") for line in out.splitlines() if line.startswith("warning: ")]


@pytest.mark.parametrize(
    ("watchdog", "judged"),
    [
        ("", "(not stated)"),
        ("watchdog_s = 0", "(off)"),
        ("watchdog_s = 7", "(7 s outlasts nothing)"),
        ("watchdog_s = 12", "(12 s outlasts a crash)"),
        ("watchdog_s = 40", "(40 s outlasts both)"),
    ],
)
def test_each_watchdog_is_judged_beside_the_gaps(
    tmp_path: Path, watchdog: str, judged: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert judged in check(tmp_path, watchdog, capsys)


def test_a_watchdog_that_a_crash_would_trip_is_a_warning_with_the_hint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (warning,) = warnings(check(tmp_path, "watchdog_s = 7", capsys))

    assert warning.startswith("starter pump-2: its watchdog of 7 s acts when the gateway crashes: ")
    assert "(make it " in warning


def test_a_watchdog_that_only_a_hang_would_trip_names_the_services_setting(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (short,) = warnings(check(tmp_path, "watchdog_s = 12", capsys))
    (longer,) = warnings(check(tmp_path, "watchdog_s = 20", capsys))

    assert "acts when the gateway hangs: " in short
    assert "WatchdogSec" not in short
    assert "or WatchdogSec=" in longer


def test_a_wide_watchdog_is_no_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert warnings(check(tmp_path, "watchdog_s = 40", capsys)) == []


def test_json_has_the_gaps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = json.loads(check(tmp_path, "watchdog_s = 40", capsys, "--json"))

    starter = shown["lines"][0]["starters"][1]
    assert starter["longest_gap_s"] < starter["crash_gap_s"] < starter["hang_gap_s"] < 40 / 1.5


def test_the_assumed_times_are_those_of_the_shipped_service() -> None:
    unit = SERVICE.read_text("utf-8")
    manager = Restart()

    assert f"\nRestartSec={manager.restart_s * 1000:.0f}ms\n" in unit
    assert f"\nWatchdogSec={manager.watchdog_s:.0f}s\n" in unit
    assert f"\nTimeoutAbortSec={manager.abort_s:.0f}s\n" in unit
