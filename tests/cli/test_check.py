from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from gateway.app.site import Site
from gateway.cli.main import main
from gateway.errors import ConfigError, Problem
from tests.config.sites import SITE, changed

PASSWORD = (
    'url = "mqtts://broker.plant:8883"',
    'url = "mqtts://broker.plant:8883"\nusername = "mcc1"\npassword_file = "mqtt.password"',
)
EXAMPLES = sorted((Path(__file__).parents[2] / "config").glob("*.toml"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "site.toml").write_text(SITE, "utf-8")
    return tmp_path


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_every_example_site_is_right_with_its_password_file(
    path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = tmp_path / path.name
    site.write_text(path.read_text("utf-8"), "utf-8")
    (tmp_path / "mqtt.password").write_text("secret\n", "utf-8")
    (tmp_path / "mqtt.password").chmod(0o600)

    assert main(["check", str(site)]) == 0

    assert f"{site}: valid, " in capsys.readouterr().out


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
    ("content", "mode", "said"),
    [
        ("secret\n", 0o600, ""),
        ("secret\n", 0o644, "others than its owner may use it (chmod 600 "),
        ("", 0o600, "is empty (write it as its first line)"),
    ],
)
def test_a_password_file_that_run_refuses_is_refused_by_check(
    content: str, mode: int, said: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    password = folder / "mqtt.password"
    password.write_text(content, "utf-8")
    password.chmod(mode)
    path = folder / "site.toml"
    path.write_text(changed(PASSWORD), "utf-8")

    checked = main(["check", str(path), "--json"])

    reported = json.loads(capsys.readouterr().out)
    assert (checked, reported["is_valid"]) == ((78, False) if said else (0, True))
    refused = _refused_by_run(path)
    assert [each["what"] for each in reported.get("problems", [])] == [each.what for each in refused]
    assert bool(refused) == bool(said)
    assert said.startswith(tuple(each.what for each in refused) or ("",))


def _refused_by_run(path: Path) -> list[Problem]:
    """Return why `run` would end before it begins."""
    try:
        Site.read(path, {})
    except ConfigError as error:
        return error.problems
    return []


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


def test_the_language_of_the_names_is_printed_with_the_families_that_lack_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def printed(language: str, family: str) -> str:
        path = tmp_path / "site.toml"
        text = changed(('name = "mcc1"', f'name = "mcc1"\nlanguage = "{language}"'))
        path.write_text(text.replace('family = "ssw07"', f'family = "{family}"'), "utf-8")
        assert main(["check", str(path)]) == 0
        return capsys.readouterr().out

    assert 'names in language = "en"; there are also: es (ssw06), pt (no family)' in printed("en", "ssw06")
    spanish = printed("es", "ssw07")
    assert 'names in language = "es"; ssw07, ssw900 in English, since no manual of theirs is in it' in spanish
    assert "there are also: pt (no family)" in spanish
