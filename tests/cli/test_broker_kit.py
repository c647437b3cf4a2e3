"""What a kit for the broker holds; what a broker makes of it: tests/end_to_end/deploy."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from gateway.cli.broker_kit.logins import logins_of
from gateway.cli.broker_kit.rights import tried_topics
from gateway.cli.broker_kit.settings import KitSettings
from gateway.cli.main import main
from gateway.config.reading import parse
from tests.config.sites import changed
from tests.rig.sites import operator, table

URL = 'url = "mqtts://broker.plant:8883"'
NAMED = (URL, f'{URL}\nusername = "mcc1"\npassword_file = "mqtt.password"')
DATED = ('starters = ["pump-*"]', 'starters = ["pump-*"]\nfreshness = "issued_at"')
SPARKPLUG = table(
    "sparkplug",
    group="plant",
    urls=["mqtt://localhost"],
    username="mcc1-spb",
    primary_host="scada",
    commands=True,
    operator="alice",
)
HOME_ASSISTANT = table("homeassistant", operator="alice")
PLAIN = (URL, 'url = "mqtt://localhost"\nusername = "mcc1"')  # needs no certificate
BOB = operator("bob", ("stop",))
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not here")
SEEN = {"starters/mcc1/starter/#", "starters/mcc1/gateway/#"}
BORN = {"NBIRTH/mcc1", "NDATA/mcc1", "NDEATH/mcc1", "DBIRTH/mcc1/+", "DDATA/mcc1/+", "DDEATH/mcc1/+"}
SPB = {f"spBv1.0/plant/{each}" for each in BORN}
STATE, NCMD, DCMD = "spBv1.0/STATE/scada", "spBv1.0/plant/NCMD/mcc1", "spBv1.0/plant/DCMD/mcc1/+"
BIRTH, DISCOVERY = "homeassistant/status", "homeassistant/device/+/config"
RESULTS, COMMANDS = "starters/mcc1/result/+/alice", "starters/mcc1/command/+/alice/#"
TELEMETRY = {*SEEN, "starters/mcc1/result/#", "starters/mcc1/audit"}
RIGHTS = {  # by login: what it reads, and what it writes
    "mcc1": ({"starters/mcc1/#", BIRTH}, {*TELEMETRY, DISCOVERY}),
    "alice": (
        {*SEEN, RESULTS, "homeassistant/#", BIRTH, "spBv1.0/plant/#", STATE},
        {COMMANDS, BIRTH, NCMD, DCMD, STATE},
    ),
    "alice-send": ({*SEEN, RESULTS}, {COMMANDS}),
    "viewer": (SEEN, set()),
    "auditor": (
        {"starters/mcc1/starter/+/event", "starters/mcc1/gateway/event", "starters/mcc1/audit"},
        set(),
    ),
    "bridge-up": ({*TELEMETRY, *SPB}, set()),
    "bridge-down": (set(), {"starters/mcc1/command/+/alice/+", NCMD, DCMD}),
    "prover": ({"starters/mcc1/#", "acl-probe/#", "homeassistant/#", BIRTH, "spBv1.0/#"}, set()),
    "mcc1-spb": ({NCMD, DCMD, STATE}, SPB),
}
MOVED = {each.replace("starters/", "acme/") for each in TELEMETRY}
CENTRAL = {
    "mcc1-up": (set(), {*MOVED, *SPB, "acme/mcc1/bridge"}),
    "mcc1-down": ({"acme/mcc1/command/+/alice/+", NCMD, DCMD}, set()),
    "alice": (
        {"acme/mcc1/starter/#", "acme/mcc1/gateway/#", "acme/mcc1/result/+/alice", "acme/mcc1/bridge"},
        {"acme/mcc1/command/+/alice/#"},
    ),
}


def made(
    tmp_path: Path, *options: str, site: str = changed(PLAIN), code: int = 0, folder: str = "kit"
) -> Path:
    """Write a kit by the command line, and return its folder."""
    path = tmp_path / "site.toml"
    path.write_text(site, "utf-8")
    assert main(["broker-kit", str(path), str(tmp_path / folder), *options]) == code
    return tmp_path / folder


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def rights(acl: Path) -> dict[str, tuple[set[str], set[str]]]:
    """Return what a list lets each login read and write."""
    found = {}
    for block in acl.read_text("utf-8").split("\nuser ")[1:]:
        name, *lines = (line for line in block.splitlines() if line and not line.startswith("#"))
        found[name] = tuple(
            {line.removeprefix(f"topic {how} ") for line in lines if line.startswith(f"topic {how} ")}
            for how in ("read", "write")
        )
    return found


def test_each_login_may_do_what_it_is_for_and_nothing_else(tmp_path: Path) -> None:
    site = changed(PLAIN, DATED) + HOME_ASSISTANT + SPARKPLUG

    kit = made(
        tmp_path, "--login=alice-send=alice", "--bridge=central", "--bridge-base=acme/{gateway}", site=site
    )

    assert rights(kit / "acl") == RIGHTS
    assert rights(kit / "central" / "acl") == CENTRAL
    conf = (kit / "bridge.conf").read_text("utf-8")
    blocks = {block.partition("\n")[0]: block for block in conf.split("\nconnection ")[1:]}
    clean = {name for name, block in blocks.items() if "cleansession true" in block}
    assert clean == {"mcc1-commands", "mcc1-edge-commands"}
    # Mosquitto's bridges ask for no session expiry: with MQTT 5 nothing would be stored for them.
    assert {name for name, block in blocks.items() if "bridge_protocol_version mqttv50" in block} == clean
    assert "topic command/+/alice/+ in 1 starters/mcc1/ acme/mcc1/" in blocks["mcc1-commands"]
    assert "topic command/+/alice/+ out 1 starters/mcc1/ starters/mcc1/" in blocks["mcc1-edge-commands"]
    assert f"topic {DCMD} in 1\n" in blocks["mcc1-commands"]
    assert "topic spBv1.0/plant/DDATA/mcc1/+ out 1\n" in blocks["mcc1-telemetry"]


def test_the_proof_tries_every_verb_and_expects_what_the_list_says() -> None:
    config = parse(changed(PLAIN), "site.toml")
    logins = logins_of(config, KitSettings())

    tried = {topic.name: topic for topic in tried_topics(config, logins)}

    for verb in ("start", "stop", "set", "unlock"):
        assert tried[f"starters/mcc1/command/acl-probe/alice/{verb}"].writers == {"alice"}
        assert tried[f"starters/mcc1/command/acl-probe/acl-probe/{verb}"].writers == set()
    assert tried["starters/mcc1/result/acl-probe/alice"].readers == {"mcc1", "alice", "prover"}
    assert tried["starters/mcc1/audit"].readers == {"mcc1", "auditor", "prover"}
    assert tried["acl-probe/acl-probe"].readers == {"prover"}
    assert tried["starters/mcc1/command/viewer/viewer/start"].triers == {"viewer"}  # a pattern with %u
    assert "starters/mcc1/command/alice/alice/start" not in tried
    assert {name for name, topic in tried.items() if topic.writers - topic.triers} == {
        "starters/mcc1/gateway/status",
        "starters/mcc1/gateway/fresh",
        *(f"starters/mcc1/starter/pump-{number}/state" for number in (1, 2)),
        *(f"starters/mcc1/command/pump-{number}/alice/start" for number in (1, 2)),
    }


@pytest.mark.parametrize(
    ("site", "up", "down"),
    [
        (changed(PLAIN) + HOME_ASSISTANT, {*TELEMETRY, DISCOVERY}, {BIRTH}),
        (changed(PLAIN, DATED) + BOB, TELEMETRY, {"starters/mcc1/command/+/alice/+"}),
    ],
    ids=["discovery, as both bases are the same", "no operator who may also prove by token"],
)
def test_a_bridge_passes(tmp_path: Path, site: str, up: set[str], down: set[str]) -> None:
    found = rights(made(tmp_path, "--bridge=central", site=site) / "acl")

    assert (found["bridge-up"], found["bridge-down"]) == ((up, set()), (set(), down))


def test_sparkplug_at_another_broker_has_no_rights_at_this_one(tmp_path: Path) -> None:
    elsewhere = changed(PLAIN) + table("sparkplug", group="plant", urls=["mqtts://other"])

    assert "spBv1.0" not in (made(tmp_path, site=elsewhere) / "acl").read_text("utf-8")


@pytest.mark.parametrize(
    ("url", "port"),
    [
        pytest.param(URL, "18883", marks=needs_openssl),
        ('url = "mqtt://localhost"', "1883"),
        ('url = "mqtt://[::1]"', "18883"),
    ],
)
def test_the_bridge_reaches_the_edge_on_a_listener_that_the_kit_has(
    tmp_path: Path, url: str, port: str
) -> None:
    kit = made(tmp_path, "--bridge=central", site=changed((URL, f'{url}\nusername = "mcc1"')))

    listeners = (kit / "mosquitto.conf").read_text("utf-8").split("\nlistener ")[1:]
    assert f"\naddress 127.0.0.1:{port}\n" in (kit / "bridge.conf").read_text("utf-8")
    assert sum(each.startswith(f"{port} 127.0.0.1\n") for each in listeners) == 1
    assert all("\nuse_username_as_clientid true\n" in f"{each}\n" for each in listeners), (
        "it is a listener's own"
    )


@needs_openssl
def test_the_brokers_certificate_has_its_names_and_is_of_the_authority(tmp_path: Path) -> None:
    kit = made(tmp_path, "--host", "b.plant", "--host", "10.0.0.7", site=changed(NAMED))

    for name in ("hostname b.plant", "hostname broker.plant", "ip 10.0.0.7"):
        verify = f"openssl verify -x509_strict -verify_{name} -CAfile ca.pem broker.pem"
        subprocess.run(verify.split(), cwd=kit, capture_output=True, check=True, timeout=20)
    public = {path.name for path in kit.rglob("*") if path.is_file() and path.stat().st_mode & 0o077}
    assert public == {"ca.pem", "broker.pem"}
    assert kit.stat().st_mode & 0o077 == 0


@needs_openssl
def test_the_plants_certificates_are_taken_where_they_fit_together_and_are_for_this_broker(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = changed(NAMED)
    plant = made(tmp_path, site=site, folder="plant")
    other = made(tmp_path, site=site.replace("broker.plant", "other.plant"), folder="other")
    kit = made(tmp_path, site=site)
    (kit / "ca.key").unlink()
    secret = ["openssl", "pkey", "-in", plant / "broker.key", "-aes128", "-passout", "pass:x", "-out"]
    subprocess.run([*secret, plant / "secret.key"], check=True, capture_output=True, timeout=20)
    (plant / "none.pem").write_text("not a certificate", "utf-8")

    for ca, cert, key, what in (
        (other / "ca.pem", other / "broker.pem", other / "broker.key", "broker.pem is not for broker.plant"),
        (plant / "ca.pem", plant / "broker.pem", other / "broker.key", "do not fit together: "),
        (other / "ca.pem", plant / "broker.pem", plant / "broker.key", "do not fit together: "),
        (plant / "ca.pem", plant / "broker.pem", plant / "secret.key", "the key without a passphrase"),
        (plant / "ca.pem", plant / "none.pem", plant / "broker.key", "do not fit together: "),
        (plant / "ca.pem", plant / "broker.pem", plant / "broker.key", ""),
    ):
        for source, name in ((ca, "ca.pem"), (cert, "broker.pem"), (key, "broker.key")):
            shutil.copy(source, kit / name)
        before = contents(kit)
        made(tmp_path, "--update", "--viewer", "panel", site=site, code=2 if what else 0)
        said = capsys.readouterr()
        assert what in said.err
        assert what or "is valid until " in said.out
        assert (contents(kit) == before) is bool(what)

    assert not (kit / "ca.key").exists()
    assert contents(kit)["broker.pem"] == contents(plant)["broker.pem"]
    made(tmp_path, "--update", "--host", "new.plant", site=site, code=2)
    assert ": broker.pem is not for new.plant (fetch ca.key back into the kit" in capsys.readouterr().err


@needs_openssl
def test_an_update_keeps_what_it_does_not_name_and_takes_away_what_an_empty_option_names(
    tmp_path: Path,
) -> None:
    site = changed(NAMED)
    kit = made(tmp_path, "--login", "two=alice", site=site)
    shutil.copy(kit / "ca.pem", kit / "central-ca.pem")
    made(tmp_path, "--update", "--bridge", "central", site=site)
    before = contents(kit)
    made(tmp_path, "--update", site=site)
    after = contents(kit)
    changes = {name for name in before if before[name] != after[name]}
    assert changes == {"broker.pem", "broker.key", "passwords", "central/passwords"}  # new salts
    assert "bridge_cafile" in after["bridge.conf"].decode()

    made(tmp_path, "--update", "--bridge", "", "--login", "", "--auditor", "", site=site)

    left = contents(kit)
    assert [name for name in left if "bridge" in name or "central" in name] == []
    assert {name for name in left if "/" in name} == {
        f"logins/{name}" for name in ("alice", "mcc1", "prover", "viewer")
    }
    assert KitSettings.read(kit).bridge == ""
