"""What `doctor` says of the broker."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.cli.main import main
from tests.mosquitto import StartMosquitto

SITE = """
[gateway]
name = "plant"
state_dir = "state"
[mqtt]
url = "mqtt://127.0.0.1:{port}"
username = "g"
password_file = "password"
[[line]]
name = "hall"
port = "/nowhere/tty"
baud = 19200
framing = "8N2"
[[line.starter]]
name = "pump-1"
address = 1
family = "ssw07"
"""


class Site:
    """A configuration, and the files of passwords beside it."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self._folder, self._capsys = folder, capsys

    def password(self, text: str, *, name: str = "password") -> str:
        path = self._folder / name
        path.write_text(text, "utf-8")
        path.chmod(0o600)
        return str(path)

    def doctor(self, port: int, *options: str) -> str:
        """Return what `doctor` prints; the line's port is an error in any case."""
        (self._folder / "site.toml").write_text(SITE.format(port=port), "utf-8")
        assert main(["doctor", str(self._folder / "site.toml"), *options]) == 1
        return self._capsys.readouterr().out


@pytest.fixture
def site(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Site:
    return Site(tmp_path, capsys)


def test_a_login_that_the_broker_takes_is_reported_and_one_that_it_refuses_is_a_problem(
    site: Site, start_mosquitto: StartMosquitto
) -> None:
    port = start_mosquitto(users={"g": "right", "alice": "hers"}).port
    alice = ("--username", "alice", "--password-file")

    site.password("right")
    assert f"ok      broker 127.0.0.1:{port}: takes the gateway's login, MQTT " in site.doctor(port)
    said = site.doctor(port, *alice, site.password("hers", name="hers"))
    assert "takes the login alice, MQTT " in said
    assert "the gateway's login" not in said  # which may be under way
    refused = site.doctor(port, *alice, site.password("wrong", name="wrong"))
    assert "the login alice: " in refused
    assert "username and password" in refused
    site.password("wrong")
    assert f"error   broker 127.0.0.1:{port}: the gateway's login: " in site.doctor(port)
