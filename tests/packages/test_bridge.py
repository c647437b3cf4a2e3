"""The kit and the bridge of docs/broker.md in fresh systems of Debian, by the pages' own commands."""

from __future__ import annotations

import json
import time

from gateway.contract import rfc3339
from tests.end_to_end.deploy.kit_site import BROKER_PAGE, commands
from tests.packages.built import Packages
from tests.packages.container import Container
from tests.packages.site import DROP_IN, IDENTIFIED, InstalledSite, site_text
from tests.rig.sites import operator

CENTRAL_BASE, CENTRAL_PORT = "acme/site1/mcc1", 8884
CENTRAL_BROKER = ("-h", "central.acme", "-p", f"{CENTRAL_PORT}", "--cafile", "/root/central-ca.pem")
CONSUMER = ("consumer", "the consumer's")
UNIT = "starter-gateway-bridge"
REMOTE = operator("dispatch", ("start", "stop"), freshness="issued_at")
TLS = 'url = "mqtts://broker.plant:8883"\nca_file = "plant-ca.pem"\npassword_file = "mqtt.password"'
CENTRAL = f"""\
listener {CENTRAL_PORT} 127.0.0.1
certfile /etc/central/cert.pem
keyfile /etc/central/key.pem
allow_anonymous false
use_username_as_clientid true
password_file /etc/central/passwords
acl_file /etc/central/acl
user mosquitto
"""


def test_the_bridges_unit_is_locked_down_and_telemetry_and_commands_pass(
    distribution: str, system: Container, packages: Packages
) -> None:
    site = InstalledSite(system, packages, distribution)
    site.install("0.3.0")
    system.write("/etc/hosts", "127.0.0.1 localhost broker.plant central.acme\n")
    with site.simulated():
        text = site_text(site.port, language="en").replace('"plant"', '"mcc1"')
        text = text.replace('url = "mqtt://127.0.0.1:1883"', TLS).replace(
            "[mqtt]", 'clock = "trusted"\n\n[mqtt]', 1
        )
        system.write("/etc/starter-gateway/site.toml", text + REMOTE)
        follow(site)
        site.drop_in("site", DROP_IN)
        system.run("systemctl", "enable", "--now", "starter-gateway")
        until(site, "starter/pump/state", '"state":"ready"')
        until(site, "starter/pump/info", IDENTIFIED)
        assert at_central(site, "bridge") == "1"
        time.sleep(3.0)  # for 2 s after a connection no start acts by its time of issue alone
        sends(site, "start")
        until(site, "starter/pump/state", '"state":"running"')
        system.run("systemctl", "restart", UNIT)
        until(site, "bridge", "1")
        sends(site, "stop")
        until(site, "starter/pump/state", '"state":"ready"')
    nothing_was_denied_to_it(site)


def follow(site: InstalledSite) -> None:
    """Do what the pages say, to the letter but for where the package has its files."""
    self_signed = "openssl req -x509 -newkey rsa:2048 -nodes -days 9 -subj /CN=central.acme"
    names = "-addext subjectAltName=DNS:central.acme -keyout /etc/central/key.pem -out /etc/central/cert.pem"
    site.system.run(
        "sh",
        "-c",
        f"mkdir /etc/central; {self_signed} {names}; cp /etc/central/cert.pem /root/central-ca.pem",
    )
    for line in commands("4. Broker"):
        if not line.startswith("apt-get "):
            site.system.run("sh", "-c", packaged(line))
    for line in commands("A bridge to a central broker", page=BROKER_PAGE):
        if line.startswith("systemctl enable"):
            starts_the_central_broker(site)
        site.system.run("sh", "-c", packaged(line))


def packaged(line: str) -> str:
    """Return a page's command with the paths that the package has."""
    line = line.replace("/opt/starter-gateway/bin/", "").replace(
        "central.acme:8883", f"central.acme:{CENTRAL_PORT}"
    )
    return "cd /; " + line.replace(" deploy/", " /usr/share/doc/starter-gateway/deploy/")


def starts_the_central_broker(site: InstalledSite) -> None:
    user, password = CONSUMER
    site.system.write("/etc/central/mosquitto.conf", CENTRAL)
    steps = (
        "cp /root/broker-kit/central/acl /root/broker-kit/central/passwords /etc/central/",
        f"printf 'user {user}\\ntopic read acme/#\\n' >> /etc/central/acl",
        f'mosquitto_passwd -b /etc/central/passwords {user} "{password}"',
        "chown -R mosquitto: /etc/central",
        "systemd-run --unit=central mosquitto -c /etc/central/mosquitto.conf",
    )
    site.system.run("sh", "-ec", "\n".join(steps))


def at_central(site: InstalledSite, topic: str) -> str:
    """Return what a consumer at the central broker gets."""
    return site.topic(f"{CENTRAL_BASE}/{topic}", CENTRAL_BROKER, CONSUMER).replace(" ", "")


def until(site: InstalledSite, topic: str, text: str) -> None:
    site.until_seen(lambda: at_central(site, topic), text, topic)


def sends(site: InstalledSite, verb: str) -> None:
    password = site.system.run("cat", "/root/broker-kit/central/logins/dispatch").strip()
    words = (*CENTRAL_BROKER, "-q", "1", "-V", "mqttv5")
    body = json.dumps({"id": verb, "issued_at": rfc3339(time.time())})
    topic = f"{CENTRAL_BASE}/command/pump/dispatch/{verb}"
    site.system.run("mosquitto_pub", *words, "-u", "dispatch", "-P", password, "-t", topic, "-m", body)


def nothing_was_denied_to_it(site: InstalledSite) -> None:
    assert site.system.run("systemctl", "show", "--property=NRestarts", "--value", UNIT).strip() == "0"
    for unit in (UNIT, "starter-gateway"):
        site.system.run("systemd-analyze", "security", "--threshold=12", unit)
    site.system.run("systemd-analyze", "verify", f"/etc/systemd/system/{UNIT}.service")
    site.system.run("systemctl", "stop", UNIT)
    assert "mosquitto.db" in site.system.run("ls", "/var/lib/mosquitto-bridge")  # what waits is stored
    said = site.system.run("journalctl", "-u", UNIT, "--no-pager")
    assert [line for line in said.splitlines() if "not permitted" in line or "denied" in line.lower()] == []
