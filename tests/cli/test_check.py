from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.cli.main import main
from tests.config.sites import SITE, changed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "site.toml").write_text(SITE, "utf-8")
    return tmp_path


def test_a_name_that_is_not_stable_gets_the_advice_of_the_stable_one(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.cli.check.stable_name", lambda port: f"/dev/serial/by-id/usb-{port[-1]}")
    (folder / "site.toml").write_text(changed(("/dev/rs485-pumps", "/dev/ttyUSB0")), "utf-8")

    assert main(["check", str(folder / "site.toml")]) == 0

    assert "adapter tomorrow (use /dev/serial/by-id/usb-0)" in capsys.readouterr().out


def test_one_adapter_under_two_names_is_a_mistake(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    here, there = os.openpty()
    device, link = os.ttyname(there), folder / "usb-FTDI"
    link.symlink_to(device)
    other = f'[[line]]\nname = "fans"\nport = "{device}"\nbaud = 9600\nframing = "8n1"\n'
    (folder / "site.toml").write_text(changed(("/dev/rs485-pumps", str(link))) + other, "utf-8")

    assert main(["check", str(folder / "site.toml")]) == 78
    os.close(here)
    os.close(there)

    error = capsys.readouterr().err
    assert f"line[1].port: '{device}' is also line[0].port (put all starters of a port under" in error


@pytest.mark.parametrize(
    ("families", "text"),
    [
        (["ssw06"] * 30, ""),
        (["ssw07"] * 31, "31 starters need a repeater, WEG SSW-07/SSW-08 allows 30 without"),
        (["ssw900"] * 32, ""),
        (["ssw900"] * 33, "33 starters need a repeater, WEG SSW900 allows 32 without"),
        (["ssw900"] * 30 + ["ssw06"], "31 starters need a repeater, WEG SSW-06 allows 30 without"),
        (["sst"] * 40, ""),
    ],
)
def test_a_line_with_more_devices_than_a_segment_carries_needs_a_repeater(
    families: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "site.toml"
    starters = "".join(
        f'[[line.starter]]\nname = "s{number}"\naddress = {number}\nfamily = "{family}"\nevery_s = 60.0\n'
        f"enabled = {'true' if number < 31 else 'false'}\n"
        for number, family in enumerate(families, 1)
    )
    head = '[gateway]\nname = "g"\n[mqtt]\nurl = "mqtt://127.0.0.1"\n[[line]]\nname = "hall"\n'
    path.write_text(f'{head}port = "/dev/rs485"\nbaud = 19200\nframing = "8N2"\n{starters}', "utf-8")

    assert main(["check", str(path)]) == 0
    assert [line for line in capsys.readouterr().out.splitlines() if "repeater" in line] == (
        [f"warning: line hall: {text} (put one in, or use more lines)"] if text else []
    )
