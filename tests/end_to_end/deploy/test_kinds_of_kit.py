"""`--prove` finds nothing wrong with any kind of kit: each listener, bridged or not, also of two gateways."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.end_to_end.deploy.kit_site import BROKER_PAGE, KitPlace, commands
from tests.mosquitto import missing_programs
from tests.rig import sites
from tests.rig.sites import ALICE, operator, starter, table

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        bool(missing_programs()) or shutil.which("openssl") is None, reason="mosquitto or openssl is not here"
    ),
]

SITE = (
    table("gateway", name="mcc1")
    + table("mqtt", url="{url}", username="mcc1", password_file="mqtt.password")
    + "{tls}"
    + sites.line("hall")
    + starter("pump-1", 1, "ssw07")
    + ALICE
)
FULL = (
    operator("dispatch", ("start", "stop"), freshness="issued_at")
    + table("homeassistant", operator="alice")
    + table("sparkplug", group="plant", urls=["{url}"], username="mcc1-spb", primary_host="scada")
    + 'commands = true\noperator = "dispatch"\n{tls}'
)
BRIDGE = " --bridge central.acme --bridge-base acme/site1/mcc1"
BARE, GUESTS = (
    " --viewer '' --auditor ''",
    " --viewer panel --viewer hall --auditor office --login alice-send=alice",
)
KINDS = {  # TLS without a bridge: test_broker_kit.py
    "TLS, a bridge, everything": ("mqtts://localhost:{port}", BRIDGE + GUESTS, FULL),
    "TLS, a bridge with the same base": ("mqtts://localhost:{port}", " --bridge central:8884" + BARE, ""),
    "this machine, a bridge, everything": ("mqtt://localhost:{port}", BRIDGE + GUESTS, FULL),
    "another address of loopback, everything": ("mqtt://127.0.0.2:{port}", GUESTS, FULL),
    # 0.0.0.0 is this machine to a client
    "any address without TLS, a bridge": ("mqtt://0.0.0.0:{port}", BRIDGE + BARE, ""),
}


@pytest.fixture
def place(tmp_path: Path) -> Iterator[KitPlace]:
    made = KitPlace(tmp_path)
    yield made
    made.stop_broker()


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_kit_is_proved(place: KitPlace, kind: str) -> None:
    address, options, more = KINDS[kind]
    url = address.format(port=place.port)
    is_tls = url.startswith("mqtts:")
    tls = 'ca_file = "plant-ca.pem"\n' if is_tls else "allow_plaintext = true\n"
    place.config.parent.mkdir()
    place.config.write_text((SITE + more).format(url=url, tls=tls), "utf-8")
    write, *install, prove = (line for line in commands("4. Broker") if not line.startswith("apt-get"))
    place.follow(write + options)
    for line in install:
        if is_tls or ".pem" not in line:
            place.follow(line)

    proofs = [prove]
    if "same base" in kind:
        proofs.append(prove.replace("site.toml", "mcc2.toml").replace("broker-kit --", "broker-kit-2 --"))
        add_gateway(place)

    for each in proofs:
        done = place.run(each)

        assert done.stdout.endswith("\nno problems\n"), done.stdout + done.stderr
        assert done.returncode == 0


def add_gateway(place: KitPlace) -> None:
    """Do what the page says of a second gateway at the same broker."""
    second = place.config.with_name("mcc2.toml")
    second.write_text(place.config.read_text("utf-8").replace("mcc1", "mcc2"), "utf-8")
    for line in commands("Changes", page=BROKER_PAGE):
        if "-2" in line:
            place.follow(line)
    place.start_broker()
