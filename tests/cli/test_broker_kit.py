"""What a kit for the broker holds; what a broker makes of it: tests/end_to_end/deploy."""

from __future__ import annotations

import base64
import shutil
import subprocess
from pathlib import Path

import pytest

from gateway.cli.broker_kit.folder import password_line
from gateway.cli.broker_kit.logins import logins_of
from gateway.cli.broker_kit.rights import tried_topics
from gateway.cli.broker_kit.settings import KitSettings
from gateway.cli.main import main
from gateway.config.reading import parse
from tests.config.sites import changed

URL = 'url = "mqtts://broker.plant:8883"'
NAMED = (URL, f'{URL}\nusername = "mcc1"\npassword_file = "mqtt.password"')
DATED = ('starters = ["pump-*"]', 'starters = ["pump-*"]\nfreshness = "issued_at"')
SPARKPLUG = """
[sparkplug]
group = "plant"
urls = ["mqtts://broker.plant"]
username = "mcc1-spb"
primary_host = "scada"
commands = true
operator = "alice"
"""
HOME_ASSISTANT = '\n[homeassistant]\noperator = "alice"\n'
PLAIN = (URL, 'url = "mqtt://localhost"\nusername = "mcc1"')  # needs no certificate
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


def made(tmp_path: Path, *options: str, site: str = changed(PLAIN), code: int = 0) -> Path:
    """Write a kit by the command line, and return its folder."""
    path = tmp_path / "site.toml"
    path.write_text(site, "utf-8")
    assert main(["broker-kit", str(path), str(tmp_path / "kit"), *options]) == code
    return tmp_path / "kit"


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
    spb = SPARKPLUG.replace("mqtts://broker.plant", "mqtt://localhost")
    site = changed(PLAIN, DATED, ("[[operator]]", f"{HOME_ASSISTANT}{spb}\n[[operator]]"))

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
    assert {name for name, topic in tried.items() if topic.is_real} == {
        "starters/mcc1/gateway/status",
        "starters/mcc1/gateway/fresh",
        *(f"starters/mcc1/starter/pump-{number}/state" for number in (1, 2)),
        *(f"starters/mcc1/command/pump-{number}/alice/start" for number in (1, 2)),
    }


def test_discovery_passes_a_bridge_whose_bases_are_the_same(tmp_path: Path) -> None:
    site = changed(PLAIN, ("[[operator]]", f"{HOME_ASSISTANT}\n[[operator]]"))

    found = rights(made(tmp_path, "--bridge=central", site=site) / "acl")

    assert found["bridge-up"] == ({*TELEMETRY, DISCOVERY}, set())
    assert found["bridge-down"] == (set(), {BIRTH})  # alice's commands are not dated


def test_an_operator_who_may_also_prove_by_token_does_not_pass_the_bridge(tmp_path: Path) -> None:
    twice = ("[[operator]]", '[[operator]]\nclient = "bob"\nmay = ["stop"]\nstarters = ["*"]\n\n[[operator]]')

    found = rights(made(tmp_path, "--bridge=central", site=changed(PLAIN, twice, DATED)) / "acl")

    assert found["bridge-down"] == (set(), {"starters/mcc1/command/+/alice/+"})


def test_sparkplug_needs_a_login_of_its_own_at_this_broker(tmp_path: Path) -> None:
    own = ("[[operator]]", '[sparkplug]\ngroup = "plant"\n\n[[operator]]')
    elsewhere = ("[[operator]]", '[sparkplug]\ngroup = "plant"\nurls = ["mqtts://other"]\n\n[[operator]]')

    made(tmp_path, site=changed(PLAIN, own), code=78)
    kit = made(tmp_path, site=changed(PLAIN, elsewhere))

    assert "spBv1.0" not in (kit / "acl").read_text("utf-8")


def test_a_password_is_hashed_as_mosquitto_passwd_does() -> None:
    salt = base64.b64decode("AAECAwQFBgcICQoL")

    line = password_line("alice", "secret", salt=salt)

    assert line.startswith("alice:$7$101$AAECAwQFBgcICQoL$")
    assert len(base64.b64decode(line.rpartition("$")[2])) == 64
    assert password_line("alice", "secret") != password_line("alice", "secret")


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


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "site.toml"
    path.write_text(changed(NAMED), "utf-8")
    return path


@needs_openssl
def test_a_bridge_whose_commands_this_clock_refuses_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "site.toml"
    name = 'name = "mcc1"'
    path.write_text(changed(NAMED, DATED, (name, f'{name}\nclock = "untrusted"')), "utf-8")
    kit = ["broker-kit", str(path), str(tmp_path / "kit")]

    assert main(kit) == 0
    without = capsys.readouterr().out
    assert main([*kit, "--update", "--bridge", "central"]) == 0
    bridged = capsys.readouterr().out

    assert "need issued_at" not in without
    assert "warning operator alice: the commands of this operator need issued_at" in bridged


@needs_openssl
def test_the_brokers_certificate_has_its_names_and_is_of_the_authority(
    config_file: Path, tmp_path: Path
) -> None:
    kit = tmp_path / "kit"
    assert main(["broker-kit", str(config_file), str(kit), "--host", "b.plant", "--host", "10.0.0.7"]) == 0

    openssl = ["openssl", "x509", "-noout", "-text", "-in", str(kit / "broker.pem")]
    shown = subprocess.run(openssl, capture_output=True, text=True, check=True, timeout=20).stdout
    assert "DNS:b.plant, IP Address:10.0.0.7" in shown
    verify = ["openssl", "verify", "-x509_strict", "-CAfile", str(kit / "ca.pem"), str(kit / "broker.pem")]
    subprocess.run(verify, capture_output=True, check=True, timeout=20)
    assert (kit / "ca.key").stat().st_mode & 0o777 == 0o600
    assert (kit / "broker.key").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--viewer", "alice"], "two logins have the name alice"),
        (["--viewer", "prover"], "two logins have the name prover"),
        (["--viewer", "acl-probe"], "two logins have the name acl-probe"),
        (["--login", "alice=alice"], "two logins have the name alice"),
        (["--viewer", "a b"], "no name for a login"),
        (["--auditor", ".."], "no name for a login"),
        (["--login", "x=carol"], "no [[operator]] carol"),
        (["--host", "a,DNS:evil"], "no name or address"),
        (["--host", "bröker.plant"], "no name or address"),
        (["--host", "a b"], "no name or address"),
        (["--host=-a"], "no name or address"),
        (["--host={gateway}"], "no name or address"),
        (["--ca", "x"], "go together"),
        (["--login", "x"], "NAME=OPERATOR"),
        (["--bridge", "central:x"], "HOST"),
        (["--bridge", "central:65536"], "HOST"),
        (["--bridge", "central evil:8883"], "HOST"),
        (["--bridge", "[::1]:8883"], "HOST"),
        (["--bridge", "central", "--bridge-base", "a/#"], "no base"),
        (["--bridge", "central", "--bridge-base", "acme/site 1"], "no base"),
        (["--bridge", "central", "--bridge-base", "acme\ntopic # out"], "no base"),
        (["--bridge", "central", "--bridge-base", "$share/acme"], "no base"),
        (["--bridge-ca", "/nowhere"], "no file"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_written(
    config_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], what: str
) -> None:
    assert main(["broker-kit", str(config_file), str(tmp_path / "kit"), *options]) == 2

    assert what in capsys.readouterr().err
    assert not (tmp_path / "kit").exists()
