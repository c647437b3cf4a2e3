"""deploy/INSTALL.md followed to the letter ends at a locked-down broker, and the proof finds every hole."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Iterator

import pytest

from tests.end_to_end.deploy.kit_site import KitPlace, commands
from tests.mosquitto import _find, missing_programs

pytestmark = pytest.mark.long

PROVE = next(line for line in commands("4. Broker") if line.endswith("--prove"))
ADDED = """
[homeassistant]
operator = "scada"

[sparkplug]
group = "plant"
urls = ["mqtts://localhost:{port}"]
username = "mcc1-spb"
ca_file = "plant-ca.pem"
primary_host = "scada"
"""

HOLES = {  # each in the list, and what the proof then finds
    ("topic write {base}/command/+/alice/#", "topic write {base}/command/#"): {
        "alice: writes commands of scada",
        "alice: writes commands of somebody unknown",
        "alice: publishes commands of scada by a last will",
    },
    ("user viewer\n", "user viewer\ntopic write {base}/command/+/alice/#\n"): {
        "viewer: writes commands of alice"
    },
    ("user auditor\n", "user auditor\ntopic read {base}/result/#\n"): {
        "auditor: reads results for alice",
        "auditor: reads results for scada",
        "auditor: reads results for somebody unknown",
    },
    ("topic read {base}/result/+/scada\n", "topic read {base}/result/#\n"): {
        "scada: reads results for alice",
        "scada: reads results for somebody unknown",
    },
    ("user viewer\n", "user viewer\ntopic write {base}/starter/+/state\n"): {
        "viewer: writes what a starter does",
        "viewer: publishes what a starter does by a last will",
    },
    ("user scada\n", "user scada\ntopic read $SYS/#\n"): {"scada: reads $SYS"},
    ("user scada\n", "user scada\ntopic write {base}/audit\n"): {"scada: writes the audit"},
    ("topic write homeassistant/device/+/config\n", ""): {"mcc1: writes discovery by Home Assistant"},
    ("user viewer\n", "user viewer\ntopic write homeassistant/#\n"): {
        "viewer: writes discovery by Home Assistant",
        "viewer: writes Home Assistant's birth",
    },
    ("user viewer\n", "user viewer\ntopic write spBv1.0/plant/#\n"): {
        "viewer: writes Sparkplug's device data",
        "viewer: writes Sparkplug's node commands",
        "viewer: writes Sparkplug's device commands",
        "viewer: writes Sparkplug's data of another node",
    },
    ("user auditor\n", "user auditor\ntopic write {base}/command/pump-1/alice/start\n"): {
        "auditor: writes commands of alice"
    },
    ("user auditor\n", "user auditor\ntopic write {base}/gateway/fresh\n"): {
        "auditor: writes what the gateway says of itself"
    },
    ("user prover\n", "user prover\ntopic write {base}/command/+/scada/stop\n"): {
        "prover: writes commands of scada"
    },
    ("user mcc1-spb\n", "user mcc1-spb\ntopic write acl-probe/#\n"): {
        "mcc1-spb: writes what is outside the base"
    },
    # a pattern is everybody's
    ("user scada\n", "pattern write {base}/command/+/%u/stop\n\nuser scada\n"): {
        f"{login}: writes commands of somebody unknown"
        for login in ("mcc1", "viewer", "auditor", "prover", "mcc1-spb", "sparkplug-host")
    },
    # before the first user: for those without a login
    ("", "topic write {base}/command/#\n\n"): set[str](),
}
OPEN = {"a client without a login: may connect"}
TAKES_ID = ": disconnects the gateway by its client id, and receives its commands"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KitPlace]:
    """Where the commands of INSTALL.md have been followed."""
    missing = missing_programs() + ([] if shutil.which("openssl") else ["openssl"])
    if missing:
        pytest.skip(f"not installed: {', '.join(missing)}")
    installed = KitPlace(tmp_path_factory.mktemp("installed"))
    try:
        for line in commands("3. Configuration", "4. Broker"):
            if line != PROVE:
                installed.follow(line)
        yield installed
    finally:
        installed.stop_broker()


@pytest.fixture(scope="module")
def proof(place: KitPlace) -> subprocess.CompletedProcess[str]:
    """What the last command of the section says."""
    return place.run(PROVE)


@pytest.fixture(scope="module")
def holed(place: KitPlace, proof: subprocess.CompletedProcess[str]) -> subprocess.CompletedProcess[str]:
    """What it says of an updated kit with Home Assistant and Sparkplug, and every hole at once."""
    with place.config.open("a", encoding="utf-8") as config:
        config.write(ADDED.format(port=place.port))
    write, *install = (line for line in commands("4. Broker") if "/root/broker-kit" in line and line != PROVE)
    place.follow(write.partition(" --host")[0] + " --update")
    for line in install[:3]:
        place.follow(line)
    acl = place.root / "etc/mosquitto/starter-gateway/acl"
    text = acl.read_text("utf-8")
    for old, new in HOLES:
        old, new = (part.replace("{base}", "starters/mcc1") for part in (old, new))
        assert old in text, old
        text = text.replace(old, new) if old else new + text
    acl.write_text(text, "utf-8")
    conf = place.root / "etc/mosquitto/conf.d/starter-gateway.conf"
    conf.write_text(
        conf.read_text("utf-8")
        .replace("allow_anonymous false", "allow_anonymous true")
        .replace("use_username_as_clientid true", ""),
        "utf-8",
    )
    place.start_broker()
    return place.run(PROVE)


def wrong(done: subprocess.CompletedProcess[str]) -> set[str]:
    """Return where something is wrong, and what, without the remedy."""
    lines = (line for line in done.stdout.splitlines() if line.startswith("error "))
    return {line.removeprefix("error").partition(" (")[0].strip() for line in lines}


def test_the_broker_of_the_install_note_is_proved(proof: subprocess.CompletedProcess[str]) -> None:
    assert proof.returncode == 0, proof.stdout + proof.stderr
    assert "ok      alice: reads what a starter does" in proof.stdout
    assert "ok      auditor: reads events of a starter, reads the audit\n" in proof.stdout


def test_a_program_that_has_a_login_meanwhile_is_named(place: KitPlace, proof: object) -> None:
    password = (place.kit / "logins/scada").read_text("utf-8").strip()
    again = f"while :; do {_find('mosquitto_pub')} -h localhost -p {place.port} --cafile {place.kit}/ca.pem"
    again += f" -V mqttv5 -u scada -P {password} -t x -n; sleep 0.3; done"
    program = subprocess.Popen(["sh", "-c", again], stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        done = place.run(PROVE)
    finally:
        os.killpg(program.pid, signal.SIGKILL)
        program.wait(10)

    assert done.returncode == 1
    assert "error   scada: was disconnected while it was tried: end the program" in done.stdout
    assert not [each for each in wrong(done) if not each.startswith("scada")]


@pytest.mark.parametrize("hole", HOLES, ids=lambda hole: (hole[1] or f"no {hole[0]}").strip())
def test_each_hole_is_found(holed: subprocess.CompletedProcess[str], hole: tuple[str, str]) -> None:
    assert holed.returncode == 1, holed.stderr
    assert HOLES[hole] <= wrong(holed), holed.stdout


def test_nothing_is_called_wrong_but_what_is(holed: subprocess.CompletedProcess[str]) -> None:
    found = {what for what in wrong(holed) if not what.endswith(TAKES_ID) and "last will" not in what}

    expected = {what for each in HOLES.values() for what in each if "last will" not in what}
    assert found == expected | OPEN


def test_that_everybody_may_choose_a_client_id_is_found(holed: subprocess.CompletedProcess[str]) -> None:
    takers = {each.removesuffix(TAKES_ID) for each in wrong(holed) if each.endswith(TAKES_ID)}

    assert takers == {"alice", "scada", "viewer", "auditor", "prover", "mcc1-spb", "sparkplug-host"}
