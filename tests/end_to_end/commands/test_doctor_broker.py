"""What at the broker would be a problem."""

from __future__ import annotations

import asyncio
from pathlib import Path

from gateway.cli.doctor.broker import BrokerAccess
from gateway.cli.doctor.machine import DoctorFinding
from gateway.config.load import parse
from tests.mosquitto import StartMosquitto
from tests.rig.sites import ALICE, SSW07, table

LOGIN = {"username": "g", "password_file": "password"}


def site(port: int = 1) -> str:
    return (
        table("gateway", name="plant")
        + table("mqtt", url=f"mqtt://127.0.0.1:{port}", **LOGIN)
        + SSW07
        + ALICE
    )


def problems_in(remarks: list[DoctorFinding]) -> list[str]:
    return [f"{remark.where}: {remark.text}" for remark in remarks if remark.is_problem]


def remarks_of(text: str, folder: Path) -> list[DoctorFinding]:
    access = BrokerAccess(parse(text, "site.toml"), folder)
    return asyncio.run(access.remarks())


def test_a_password_file_that_others_may_read_is_a_problem(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("secret\n", "utf-8")
    (tmp_path / "password").chmod(0o644)

    (problem,) = problems_in(remarks_of(site(), tmp_path))

    assert "chmod 600" in problem
    assert "secret" not in problem


def test_a_login_that_the_broker_takes_is_reported_and_one_that_it_refuses_is_a_problem(
    tmp_path: Path, start_mosquitto: StartMosquitto
) -> None:
    broker = start_mosquitto(users={"g": "right"})
    is_a_problem = []
    for password in ("right", "wrong"):
        (tmp_path / "password").write_text(password, "utf-8")
        (tmp_path / "password").chmod(0o600)
        is_a_problem.append(problems_in(remarks_of(site(broker.port), tmp_path)))

    assert is_a_problem[0] == []
    assert len(is_a_problem[1]) == 1


def test_the_doctor_logs_in_as_the_operator_that_is_named(
    tmp_path: Path, start_mosquitto: StartMosquitto
) -> None:
    broker = start_mosquitto(users={"g": "right", "alice": "hers"})
    for name, password in (("password", "right"), ("hers", "hers"), ("wrong", "wrong")):
        (tmp_path / name).write_text(password, "utf-8")
        (tmp_path / name).chmod(0o600)
    config = parse(site(broker.port), "site.toml")

    def remarks(file: str) -> list[DoctorFinding]:
        path = str(tmp_path / file)
        access = BrokerAccess(config, tmp_path, client="alice", username="alice", password_file=path)
        return asyncio.run(access.remarks())

    reported = [remark.text for remark in remarks("hers")]
    assert any(text.startswith("takes the login alice, MQTT ") for text in reported)
    assert not any("the gateway's login" in text for text in reported)  # which may be under way
    (problem,) = problems_in(remarks("wrong"))
    assert "the login alice: " in problem
    assert "username and password" in problem
