"""The script that proves the access list, on a real Mosquitto: a right list is proved, a wrong one is not."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.conftest import StartMosquitto
from tests.mosquitto import MosquittoBroker

MOSQUITTO = Path(__file__).parents[2] / "deploy" / "mosquitto"
SCRIPT = MOSQUITTO / "prove-acl.sh"
ACL = (MOSQUITTO / "acl").read_text("utf-8")
USERS = {name: f"{name}:password" for name in ("mcc1", "alice", "bob", "viewer", "auditor", "prover")}
TIED = tuple(
    line
    for line in (MOSQUITTO / "mosquitto.conf").read_text("utf-8").splitlines()
    if line.startswith("use_username_as_clientid")
)


def login(name: str) -> str:
    return f"{name}:{USERS[name]}"


def prove(broker: MosquittoBroker, *options: str) -> subprocess.CompletedProcess[str]:
    eyes = ("--gateway", login("mcc1"), "--prover", login("prover"))
    who = (*eyes, "--operator", login("alice"), "--operator", login("bob"))
    viewers = ("--viewer", login("viewer"), "--viewer", login("auditor"))
    where = ("--", "-h", broker.host, "-p", str(broker.port))
    command = [str(SCRIPT), *who, *viewers, *options, *where]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0)


def wrong(done: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in done.stdout.splitlines() if line.startswith("WRONG")]


@pytest.mark.mosquitto
def test_the_list_that_we_ship_is_proved(start_mosquitto: StartMosquitto) -> None:
    done = prove(start_mosquitto(users=USERS, acl=ACL, options=TIED))

    assert TIED == ("use_username_as_clientid true",)
    assert done.returncode == 0, done.stdout + done.stderr
    assert wrong(done) == []
    assert "ok    alice commands as bob: is refused\n" in done.stdout
    assert "ok    alice commands as bob by a last will: is refused\n" in done.stdout
    assert "ok    somebody without a login commands: is refused\n" in done.stdout
    assert "ok    alice takes the gateway's client id, and its commands: is refused\n" in done.stdout
    assert "ok    viewer takes the gateway's client id, and its commands: is refused\n" in done.stdout


@pytest.mark.mosquitto
def test_a_broker_that_lets_everybody_choose_a_client_id_is_not(start_mosquitto: StartMosquitto) -> None:
    done = prove(start_mosquitto(users=USERS, acl=ACL))

    assert done.returncode == 1
    assert {line.partition(" takes ")[0] for line in wrong(done)} == {
        f"WRONG {name}" for name in ("alice", "bob", "viewer", "auditor")
    }


@pytest.mark.mosquitto
@pytest.mark.parametrize(
    ("change", "found"),
    [
        (("command/+/alice/#", "command/#"), "WRONG alice commands as bob: arrives"),
        (("user viewer\n", "user viewer\ntopic write starters/mcc1/command/#\n"), "WRONG viewer, who only"),
        (
            ("user viewer\n", "user viewer\ntopic write starters/mcc1/result/#\n"),
            "WRONG viewer publishes a result to alice",
        ),
        (("user bob\n", "user bob\ntopic write starters/mcc1/starter/#\n"), "WRONG bob says what a starter"),
        (
            ("user bob\n", "user bob\ntopic write starters/mcc1/result/#\n"),
            "WRONG bob publishes a result to alice",
        ),
        (
            ("topic write starters/mcc1/command/+/bob/#\n", ""),
            "WRONG bob commands under the own name: is refused",
        ),
    ],
)
def test_a_list_with_a_hole_is_not(
    start_mosquitto: StartMosquitto, change: tuple[str, str], found: str
) -> None:
    assert change[0] in ACL

    done = prove(start_mosquitto(users=USERS, acl=ACL.replace(*change), options=TIED))

    assert done.returncode == 1
    assert any(line.startswith(found) for line in wrong(done)), done.stdout


@pytest.mark.mosquitto
def test_a_broker_that_lets_everybody_in_is_not(start_mosquitto: StartMosquitto) -> None:
    acl = f"topic write starters/mcc1/command/#\n\n{ACL}"  # before the first user: for those without a login

    done = prove(start_mosquitto(users=USERS, acl=acl, options=("allow_anonymous true",)))

    assert done.returncode == 1
    assert [line for line in wrong(done) if line.startswith("WRONG somebody without a login commands")]


@pytest.mark.mosquitto
def test_a_login_that_the_broker_does_not_know_is_reported(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto(users=USERS, acl=ACL)

    done = prove(broker, "--prover", "prover:wrong")

    assert done.returncode == 1
    assert "cannot listen" in done.stderr


def test_without_its_logins_it_says_how_it_is_used() -> None:
    done = subprocess.run([str(SCRIPT)], capture_output=True, text=True, check=False)

    assert done.returncode == 2
    assert "--operator U:P" in done.stderr
