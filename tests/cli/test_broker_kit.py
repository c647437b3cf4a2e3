"""What a kit for the broker holds, decided without a broker."""

from __future__ import annotations

import base64
import shutil
import subprocess
from pathlib import Path

import pytest

from gateway.cli.broker_kit.bridge import (
    CentralBroker,
    bridge_conf,
    central_logins,
    commands,
    edge_logins,
    telemetry,
)
from gateway.cli.broker_kit.expected import topics_of
from gateway.cli.broker_kit.folder import password_line
from gateway.cli.broker_kit.kit import broker_conf
from gateway.cli.broker_kit.lint import overlap, warnings
from gateway.cli.broker_kit.logins import KitSettings, Login, access_list, logins_of, remote_clients
from gateway.cli.main import main
from gateway.errors import ConfigError, UsageError
from tests.config.sites import changed, site

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
WITH_ALL = ("[[operator]]", f"{HOME_ASSISTANT}{SPARKPLUG}\n[[operator]]")
CENTRAL = CentralBroker("central", 8883, "acme/mcc1", "/ca.pem")

needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not here")


def allows(login: Login, topic: str, *, writing: bool) -> bool:
    return any(overlap(each, topic) for each in (login.writes if writing else login.reads))


@pytest.mark.parametrize("bridged", [False, True])
def test_the_access_list_gives_what_the_proof_demands_and_nothing_else(bridged: bool) -> None:
    config = site(NAMED, DATED, WITH_ALL)
    logins = logins_of(config, KitSettings(further={"alice-send": "alice"}))
    logins += edge_logins(config, config.base) if bridged else ()

    for topic in topics_of(config, logins):
        assert {each.name for each in logins if allows(each, topic.name, writing=True)} == topic.writers
        if topic.writers:
            assert {each.name for each in logins if allows(each, topic.name, writing=False)} == topic.readers


@pytest.mark.parametrize(
    ("guests", "what"),
    [
        (KitSettings(viewers=("alice",)), "two logins have the name alice"),
        (KitSettings(viewers=("prover",)), "the proof's own"),
        (KitSettings(viewers=("a b",)), "no name for a login"),
        (KitSettings(viewers=("..",)), "no name for a login"),
        (KitSettings(viewers=("acl-probe",)), "the proof's own"),
        (KitSettings(further={"x": "carol"}), "no \\[\\[operator\\]\\] carol"),
    ],
)
def test_logins_that_cannot_be_are_refused(guests: KitSettings, what: str) -> None:
    with pytest.raises(UsageError, match=what):
        logins_of(site(NAMED), guests)


def test_sparkplug_needs_a_login_of_its_own_at_this_broker() -> None:
    own = ("[[operator]]", '[sparkplug]\ngroup = "plant"\n\n[[operator]]')
    elsewhere = ("[[operator]]", '[sparkplug]\ngroup = "plant"\nurls = ["mqtts://other"]\n\n[[operator]]')

    with pytest.raises(ConfigError, match="mcc1-spb"):
        logins_of(site(NAMED, own), KitSettings())
    assert "spBv1.0" not in access_list(logins_of(site(NAMED, elsewhere), KitSettings()))


def test_a_password_is_hashed_as_mosquitto_passwd_does() -> None:
    salt = base64.b64decode("AAECAwQFBgcICQoL")

    line = password_line("alice", "secret", salt=salt)

    assert line.startswith("alice:$7$101$AAECAwQFBgcICQoL$")
    assert len(base64.b64decode(line.rpartition("$")[2])) == 64
    assert password_line("alice", "secret") != password_line("alice", "secret")


def test_only_operators_whose_commands_are_dated_pass_the_bridge() -> None:
    twice = ("[[operator]]", '[[operator]]\nclient = "bob"\nmay = ["stop"]\nstarters = ["*"]\n\n[[operator]]')

    assert remote_clients(site(NAMED, twice)) == ()
    assert remote_clients(site(NAMED, twice, DATED)) == ("alice",)
    assert commands(site(NAMED), "acme/mcc1") == ()


def test_the_bridge_names_every_topic_and_waits_only_with_telemetry() -> None:
    config = site(NAMED, DATED, WITH_ALL)
    passwords = dict.fromkeys(("bridge-up", "bridge-down", "mcc1-up", "mcc1-down"), "x")

    conf = bridge_conf(config, CENTRAL, passwords, passwords)

    blocks = {block.partition("\n")[0]: block for block in conf.split("\nconnection ")[1:]}
    clean = {name for name, block in blocks.items() if "cleansession true" in block}
    assert clean == {"mcc1-commands", "mcc1-edge-commands"}
    # Mosquitto's bridges ask for no session expiry: with MQTT 5 nothing would be stored for them.
    newer = {name for name, block in blocks.items() if "bridge_protocol_version mqttv50" in block}
    assert newer == clean
    assert "topic +/alice/+ in 1 starters/mcc1/command/ acme/mcc1/command/" in blocks["mcc1-commands"]
    assert (
        "topic +/alice/+ out 1 starters/mcc1/command/ starters/mcc1/command/" in blocks["mcc1-edge-commands"]
    )
    assert "topic spBv1.0/plant/DCMD/mcc1/+ in 1" in blocks["mcc1-commands"]
    assert "topic spBv1.0/plant/DDATA/mcc1/+ out 1" in blocks["mcc1-telemetry"]
    assert "homeassistant" not in conf  # the bases differ
    assert list(warnings(conf, config.base)) == []


@pytest.mark.parametrize(
    ("url", "port"),
    [(URL, "18883"), ('url = "mqtt://localhost"', "1883"), ('url = "mqtt://[::1]"', "18883")],
)
def test_the_bridge_reaches_the_edge_on_a_listener_that_the_kit_has(url: str, port: str) -> None:
    config = site((URL, f'{url}\nusername = "mcc1"'))
    passwords = dict.fromkeys(("bridge-up", "bridge-down", "mcc1-up", "mcc1-down"), "x")

    conf = bridge_conf(config, CENTRAL, passwords, passwords)

    listeners = broker_conf(config, has_bridge=True).split("\nlistener ")[1:]
    assert f"\naddress 127.0.0.1:{port}\n" in conf
    assert sum(each.startswith(f"{port} 127.0.0.1\n") for each in listeners) == 1
    assert all("\nuse_username_as_clientid true\n" in each for each in listeners), "it is a listener's own"
    assert "127.0.0.1" not in broker_conf(site(NAMED), has_bridge=False)


def test_discovery_passes_a_bridge_whose_bases_are_the_same() -> None:
    config = site(NAMED, DATED, WITH_ALL)

    assert ("homeassistant/device/+/config", "") in telemetry(config, config.base)
    assert ("homeassistant/status", "") in commands(config, config.base)


def test_no_login_of_the_central_broker_reaches_beyond_its_site() -> None:
    logins = central_logins(site(NAMED, DATED), "acme/mcc1")

    filters = [each for login in logins for each in (*login.reads, *login.writes)]
    assert {login.name for login in logins} == {"mcc1-up", "mcc1-down", "alice"}
    assert [each for each in filters if not each.startswith("acme/mcc1/")] == []
    up, down = logins[0], logins[1]
    assert (up.reads, down.writes) == ([], [])


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
    assert "warning: operator alice: the commands of this operator need issued_at" in bridged


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
        (["--ca", "x"], "go together"),
        (["--login", "x"], "NAME=OPERATOR"),
        (["--bridge", "central:x"], "HOST"),
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
