"""What at the broker would bite."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from gateway.commands.doctor_broker import BrokerAccess
from gateway.commands.doctor_remark import Remark
from gateway.config.load import parse
from gateway.errors import BrokerError
from gateway.mqtt import sender
from tests.commands.doctor_site import biting, site
from tests.conftest import StartMosquitto


def remarks_of(text: str, folder: Path) -> list[Remark]:
    access = BrokerAccess(parse(text, "site.toml"), folder)
    return asyncio.run(access.remarks())


def test_a_broker_that_is_away_bites() -> None:
    (bite,) = biting(remarks_of(site(port=1), Path("/tmp")))

    assert bite.startswith("broker 127.0.0.1:1: ")


def test_a_password_file_that_others_may_read_bites(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("secret\n", "utf-8")
    (tmp_path / "password").chmod(0o644)

    (bite,) = biting(remarks_of(site(login='username = "g"\npassword_file = "password"'), tmp_path))

    assert "chmod 600" in bite
    assert "secret" not in bite


@pytest.mark.mosquitto
def test_a_login_that_the_broker_takes_is_told_and_one_that_it_refuses_bites(
    tmp_path: Path, start_mosquitto: StartMosquitto
) -> None:
    broker = start_mosquitto(users={"g": "right"})
    login = 'username = "g"\npassword_file = "password"'
    bites = []
    for password in ("right", "wrong"):
        (tmp_path / "password").write_text(password, "utf-8")
        (tmp_path / "password").chmod(0o600)
        bites.append(biting(remarks_of(site(port=broker.port, login=login), tmp_path)))

    assert bites[0] == []
    assert len(bites[1]) == 1


def test_nothing_is_asked_of_a_broker_that_cannot_be_used() -> None:
    access = BrokerAccess(parse(site(), "site.toml"), Path("/tmp"))

    with pytest.raises(BrokerError, match="cannot be used"):
        asyncio.run(access.read("pump-1", ["P220"]))


@pytest.mark.mosquitto
def test_a_gateway_that_does_not_run_and_a_starter_that_nobody_may_read_cannot_be_asked(
    tmp_path: Path, start_mosquitto: StartMosquitto, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender, "STATUS_WITHIN_S", 0.05)
    access = BrokerAccess(parse(site(port=start_mosquitto().port), "site.toml"), tmp_path)
    assert biting(asyncio.run(access.remarks())) == []

    with pytest.raises(BrokerError, match="no operator may read it"):
        asyncio.run(access.read("fan", ["P220"]))
    with pytest.raises(BrokerError, match="no gateway has told its state"):
        asyncio.run(access.read("pump-1", ["P220"]))
