"""`send` against a real Mosquitto; the gateway's part is played here, by its own intake and payloads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.cli.main import main
from gateway.contract import FreshRecord, StatusRecord, Topics
from gateway.errors import BrokerError
from gateway.mqtt.connection.settings import BrokerSettings
from tests.config.sites import changed
from tests.mosquitto import StartMosquitto

TOPICS = Topics("starters/mcc1")
BOOT = "boot-1"
Send = Callable[..., tuple[int, str, str]]


@pytest.fixture
def send(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Send:
    """Give a function that runs `send` with a site whose broker is at a port: exit code, stdout, stderr."""

    def run(port: int, *words: str) -> tuple[int, str, str]:
        path = tmp_path / "site.toml"
        path.write_text(changed(("mqtts://broker.plant:8883", f"mqtt://127.0.0.1:{port}")), "utf-8")
        code = main(["send", str(path), *words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


def test_a_login_without_the_right_to_write_is_reported(
    start_mosquitto: StartMosquitto, send: Send, tmp_path: Path
) -> None:
    acl = "user alice\ntopic read starters/#\nuser mcc1\ntopic readwrite starters/#\n"
    broker = start_mosquitto(users={"alice": "a", "mcc1": "m"}, acl=acl)
    status = StatusRecord(state="online", time_s=0.0, boot="b", since_s=0.0, reason=None, run="r")
    for said in (FreshRecord(token="t", time_s=0.0), status):
        broker.publish(TOPICS.of(type(said)), said.payload().decode(), "-r", user=("mcc1", "m"))
    (tmp_path / "alice.password").write_text("a\n")
    (tmp_path / "alice.password").chmod(0o600)
    words = ("pump-1", "start", "--username", "alice", "--password-file", str(tmp_path / "alice.password"))

    code, _, error = send(broker.port, *words)

    assert code == 1
    assert f"does not let user alice write {TOPICS.command('pump-1', 'alice', 'start')}" in error


def test_the_password_of_another_login_is_asked_for_or_taken_from_the_environment(
    send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    logins: list[tuple[str | None, str | None]] = []

    def note(settings: BrokerSettings, _: Topics) -> None:
        logins.append((settings.username, settings.password))
        raise BrokerError("enough")

    monkeypatch.setattr("gateway.cli.send.CommandClient", note)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("getpass.getpass", lambda prompt: f"typed at {prompt!r}")

    send(1, "pump-1", "start", "--username", "alice")
    monkeypatch.setenv("STARTER_GATEWAY_MQTT_PASSWORD", "a")
    send(1, "pump-1", "start", "--username", "alice")
    send(1, "pump-1", "start")

    assert logins == [("alice", "typed at 'Password of alice at 127.0.0.1: '"), ("alice", "a"), (None, "a")]
