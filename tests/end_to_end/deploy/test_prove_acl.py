"""The script that proves the access list, on a real Mosquitto: a right list is proved, a wrong one is not."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.mosquitto import MosquittoBroker, StartMosquitto

# One process for all, since they share two proofs.
pytestmark = [pytest.mark.long, pytest.mark.xdist_group("access list")]

MOSQUITTO = Path(__file__).parents[3] / "deploy" / "mosquitto"
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


def wrong(done: subprocess.CompletedProcess[str]) -> dict[str, str]:
    """Return which probes went wrong, and how."""
    lines = [line for line in done.stdout.splitlines() if line.startswith("WRONG ")]
    return {
        what: found for what, _, found in (line.removeprefix("WRONG ").rpartition(": ") for line in lines)
    }


HOLES = {  # each in the list, and what the proof then finds
    ("command/+/alice/#", "command/#"): {"alice commands as bob", "alice commands as bob by a last will"},
    ("user viewer\n", "user viewer\ntopic write starters/mcc1/command/#\n"): {
        "viewer, who only looks on, commands",
        "viewer commands as alice",
    },
    ("user viewer\n", "user viewer\ntopic write starters/mcc1/result/#\n"): {"viewer tells alice a result"},
    ("user bob\n", "user bob\ntopic write starters/mcc1/starter/#\n"): {"bob says what a starter does"},
    ("user bob\n", "user bob\ntopic write starters/mcc1/result/#\n"): {
        "bob tells himself a result",
        "bob tells alice a result",
    },
    ("topic write starters/mcc1/command/+/bob/#\n", ""): {"bob commands under the own name"},
    # before the first user: for those without a login
    ("", "topic write starters/mcc1/command/#\n\n"): {"somebody without a login commands"},
}
TAKES_ID = " takes the gateway's client id, and its commands"


@pytest.fixture(scope="module")
def right(start_brokers: StartMosquitto) -> subprocess.CompletedProcess[str]:
    """What the proof says of the list that we ship."""
    return prove(start_brokers(users=USERS, acl=ACL, options=TIED))


@pytest.fixture(scope="module")
def holed(start_brokers: StartMosquitto) -> subprocess.CompletedProcess[str]:
    """What it says of one broker with every hole at once, since a proof takes 20 seconds."""
    acl = ACL
    for old, new in HOLES:
        assert old in acl
        acl = acl.replace(old, new) if old else new + acl
    return prove(start_brokers(users=USERS, acl=acl, options=("allow_anonymous true",)))


def test_the_list_that_we_ship_is_proved(right: subprocess.CompletedProcess[str]) -> None:
    assert TIED == ("use_username_as_clientid true",)
    assert right.returncode == 0, right.stdout + right.stderr
    assert wrong(right) == {}
    assert "ok    alice commands as bob: is refused\n" in right.stdout
    assert "ok    alice commands as bob by a last will: is refused\n" in right.stdout
    assert "ok    somebody without a login commands: is refused\n" in right.stdout
    assert "ok    alice takes the gateway's client id, and its commands: is refused\n" in right.stdout
    assert "ok    viewer takes the gateway's client id, and its commands: is refused\n" in right.stdout


def test_a_list_with_holes_is_not(holed: subprocess.CompletedProcess[str]) -> None:
    assert holed.returncode == 1


@pytest.mark.parametrize("hole", HOLES, ids=lambda hole: (hole[1] or "no " + hole[0]).strip())
def test_each_hole_is_found(holed: subprocess.CompletedProcess[str], hole: tuple[str, str]) -> None:
    assert HOLES[hole] <= wrong(holed).keys(), holed.stdout


def test_a_right_that_is_missing_is_told_as_refused(holed: subprocess.CompletedProcess[str]) -> None:
    refused = {what for what, found in wrong(holed).items() if found == "is refused, but arrives is right"}

    assert refused == {"bob commands under the own name"}


def test_that_everybody_may_choose_a_client_id_is_found(holed: subprocess.CompletedProcess[str]) -> None:
    takers = {what.removesuffix(TAKES_ID) for what in wrong(holed) if what.endswith(TAKES_ID)}

    assert takers == {"alice", "bob", "viewer", "auditor"}


def test_nothing_is_called_wrong_but_what_is(holed: subprocess.CompletedProcess[str]) -> None:
    found = {what for what in wrong(holed) if not what.endswith(TAKES_ID)}

    assert found == set().union(*HOLES.values())


def test_a_login_that_the_broker_does_not_know_is_told(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto(users=USERS, acl=ACL)

    done = prove(broker, "--prover", "prover:wrong")

    assert done.returncode == 1
    assert "cannot listen" in done.stderr


def test_without_its_logins_it_says_how_it_is_used() -> None:
    done = subprocess.run([str(SCRIPT)], capture_output=True, text=True, check=False)

    assert done.returncode == 2
    assert "--operator U:P" in done.stderr
