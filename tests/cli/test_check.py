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


def test_a_file_that_this_user_may_not_read_is_a_warning(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.cli.check.os.access", lambda path, _: path.name != "plant-ca.pem")
    (folder / "plant-ca.pem").write_text("", "utf-8")
    url = 'url = "mqtts://broker.plant:8883"'
    (folder / "site.toml").write_text(changed((url, f'{url}\nca_file = "plant-ca.pem"')), "utf-8")

    assert main(["check", str(folder / "site.toml")]) == 0

    assert "plant-ca.pem may not be read (let this user read it)" in capsys.readouterr().out


def test_one_adapter_under_two_names_is_a_mistake(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    here, there = os.openpty()
    device, link = os.ttyname(there), folder / "usb-FTDI"
    link.symlink_to(device)
    other = f'[[line]]\nname = "fans"\nport = "{device}"\nbaud = 9600\nframing = "8N1"\n'
    other += '[[line.starter]]\nname = "fan"\naddress = 1\nfamily = "ssw07"\n'
    (folder / "site.toml").write_text(changed(("/dev/rs485-pumps", str(link))) + other, "utf-8")

    assert main(["check", str(folder / "site.toml")]) == 78
    os.close(here)
    os.close(there)

    error = capsys.readouterr().err
    assert f"line[1].port: '{device}' is also line[0].port (put all starters of a port under" in error
