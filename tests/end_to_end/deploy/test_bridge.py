"""The bridge of docs/broker.md between two real Mosquittos, over a link that is cut."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from paho.mqtt.client import MQTTMessage

from gateway.client import Client
from gateway.contract import rfc3339
from tests.end_to_end.deploy.kit_site import BROKER_PAGE, KitPlace, commands
from tests.end_to_end.site import Program, Scada
from tests.mosquitto import Certificate, MosquittoBroker, StartMosquitto
from tests.relay import Relay
from tests.rig import sites
from tests.rig.sites import ALICE, operator, starter, table
from tests.waiting import until

pytestmark = [
    pytest.mark.paired,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not here"),
]

BASE, CENTRAL_BASE = "starters/mcc1", "acme/site1/mcc1"
CUT_S = 6.0
AWAY_S = 2.0
CONNECTED_S = 2.5  # for 2 s after a connection no dated start acts
STALLED_S = 6.5  # more than the 5 s that a command is good for
ATTEMPT = "Connecting bridge (step 1) mcc1-telemetry"
CONSUMER = ("consumer", "consumer's")
SITE = (
    table("gateway", name="mcc1", state_dir="state", clock="trusted")
    + table("mqtt", url="mqtts://localhost:8883", username="mcc1", password_file="mqtt.password")
    + 'ca_file = "plant-ca.pem"\n'
    + sites.line("hall", port="{port}", adapter_allowance_s=0.3)
    + starter("pump", 1, "ssw07", every_s=0.1)
    + ALICE
    + operator("dispatch", ("start", "stop"), freshness="issued_at")
)


class Observed(Scada):
    """What a client of one broker has seen, all of it, too."""

    def __init__(self, base: str, port: int, user: tuple[str, str], ca: Path | None = None) -> None:
        super().__init__(port, base=base, client="dispatch", user=user, ca=ca)
        self.messages: list[tuple[str, str]] = []

    def take(self, message: MQTTMessage) -> None:
        self.messages.append((message.topic, message.payload.decode()))
        super().take(message)

    def numbered(self) -> dict[tuple[str, str, int], str]:
        """Return the payload of each message that has a name of its own: topic, boot, seq."""
        found = {}
        for topic, text in self.messages:
            body = json.loads(text) if text.startswith("{") else {}
            if "seq" in body and "boot" in body:
                found[topic.removeprefix(self.base), body["boot"], body["seq"]] = text
        return found


@dataclass
class Bridged:
    """Two brokers, a bridge, a gateway with a simulated starter, and who watches."""

    place: KitPlace
    central: MosquittoBroker
    link: Relay
    at_edge: Observed
    at_central: Observed
    logins: dict[str, str]  # of the central broker

    async def send(self, topic: str, payload: str) -> None:
        """Publish at the central broker, as the remote operator."""
        user = ("dispatch", self.logins["dispatch"])
        await asyncio.to_thread(self.central.publish, topic, payload, user=user)

    async def command(self, verb: str, id_: str) -> None:
        """Send a command as the remote operator, dated now."""
        body = json.dumps({"id": id_, "issued_at": rfc3339(time.time())})
        await self.send(f"{CENTRAL_BASE}/command/pump/dispatch/{verb}", body)

    async def local(self, verb: str) -> None:
        """Send a command at the edge, as alice, and wait for its end."""
        url = f"mqtt://127.0.0.1:{self.place.loopback_port}"
        password = (self.place.kit / "logins/alice").read_text("utf-8").strip()
        alice = Client(url, base=BASE, client="alice", username="alice", password=password)
        assert (await alice.command("pump", verb)).is_confirmed


def install(place: KitPlace, link: Relay, authority: Path) -> None:
    """Follow the pages: a kit, then the bridge; only the addresses are this test's."""
    (place.root / "etc/starter-gateway").mkdir()
    text = SITE.format(port=place.root / "ttyHALL").replace(":8883", f":{place.port}")
    place.config.write_text(text, "utf-8")
    shutil.copy(authority, place.root / "root/central-ca.pem")
    for line in commands("4. Broker"):
        if line.startswith(("/opt", "install")) and not re.search(r"--prove| check ", line):
            place.follow(line)
    bridge = place.root / "etc/mosquitto/starter-gateway/bridge.conf"
    for line in commands("A bridge to a central broker", page=BROKER_PAGE):
        place.follow(line.replace("central.acme:8883", f"localhost:{link.port}"))
        if "bridge.conf /root" in line:
            text = re.sub(r"restart_timeout \d+ \d+", "restart_timeout 1 2", bridge.read_text("utf-8"))
            bridge.write_text(text, "utf-8")  # each attempt of seconds here is one of minutes there


def central_users(place: KitPlace) -> dict[str, str]:
    """Return the logins of the central broker: this site's, and a consumer's."""
    folder = place.kit / "central/logins"
    users = {each.name: each.read_text("utf-8").strip() for each in folder.iterdir()}
    return {**users, **dict([CONSUMER])}


@asynccontextmanager
async def bridged(folder: Path, start_mosquitto: StartMosquitto) -> AsyncIterator[Bridged]:
    certificate = Certificate.make(folder)
    place = KitPlace(folder / "edge")
    async with AsyncExitStack() as stack:
        link = await stack.enter_async_context(Relay(0))
        stack.callback(place.stop_broker)
        await asyncio.to_thread(install, place, link, certificate.cert)
        users = central_users(place)
        acl = (place.kit / "central/acl").read_text("utf-8")
        acl += f"user {CONSUMER[0]}\ntopic read acme/#\n"
        central = start_mosquitto(
            users=users, acl=acl, tls=certificate, options=("use_username_as_clientid true",)
        )
        link.target = central.port
        prover = ("prover", (place.kit / "logins/prover").read_text("utf-8").strip())
        here = await stack.enter_async_context(Observed(BASE, place.loopback_port, prover))
        seen = Observed(CENTRAL_BASE, central.port, CONSUMER, certificate.cert)
        there = await stack.enter_async_context(seen)
        simulator = await stack.enter_async_context(Program("gateway", "simulate", str(place.config)))
        await simulator.says("line hall")
        await stack.enter_async_context(Program("gateway", "run", str(place.config)))
        site = Bridged(place, central, link, here, there, users)
        await there.ready("pump")
        await there.until("gateway/status", state="online")
        yield site


@pytest.mark.long
async def test_nothing_acts_late_over_a_bridge_and_nothing_is_lost(
    tmp_path: Path, start_mosquitto: StartMosquitto
) -> None:
    async with bridged(tmp_path, start_mosquitto) as site:
        await asyncio.sleep(CONNECTED_S)
        await check_fresh(site)
        await check_severed(site)
        await check_stalled(site)
        await commands_pass(site)
        await check_stopped(site)
        await check_complete(site)


async def check_fresh(site: Bridged) -> None:
    """A dated start acts at once, one with a token alone is refused."""
    body = json.dumps({"id": "by-token", "token": await site.at_central.token()})
    await site.send(f"{CENTRAL_BASE}/command/pump/dispatch/start", body)
    refusal = await site.at_central.result("pump", id="by-token", phase="rejected")
    assert refusal["code"] == "not_fresh"
    assert "need issued_at" in str(refusal["text"])

    await site.command("start", "live")
    await site.at_central.result("pump", id="live", phase="confirmed")
    await site.command("stop", "live-stop")
    await site.at_central.result("pump", id="live-stop", phase="confirmed")


async def check_severed(site: Bridged) -> None:
    """A start of while the link was cut never arrives; what happened meanwhile does, without a storm."""
    site.link.cut()
    await notice(site, "0")
    before = len(site.at_central.messages), len(site.at_edge.messages)
    attempts = site.place.log("bridge").count(ATTEMPT)
    await site.command("start", "while-severed")
    await site.local("start")
    await asyncio.sleep(CUT_S)
    await site.local("stop")
    assert len(site.at_central.messages) - before[0] <= 2  # the notice, and the start itself

    await site.link.join()
    await notice(site, "1")
    await settled(site)

    assert "while-severed" not in str(site.at_edge.messages)
    edge, central = len(site.at_edge.messages) - before[1], len(site.at_central.messages) - before[0]
    attempts = site.place.log("bridge").count(ATTEMPT) - attempts
    retained = len({topic for topic, _ in site.at_edge.messages})
    assert attempts >= 2
    assert central <= edge + (attempts + 2) * retained  # Mosquitto queues what is retained with each attempt
    quiet = len(site.at_central.messages), len(site.at_edge.messages)
    await asyncio.sleep(2.0)
    grown = len(site.at_central.messages) - quiet[0], len(site.at_edge.messages) - quiet[1]
    assert grown[0] <= grown[1] + 5


async def check_stalled(site: Bridged) -> None:
    """A start that was held up on an open connection arrives, and is refused."""
    site.link.stall()
    await site.command("start", "held-up")
    await asyncio.sleep(STALLED_S)
    assert "held-up" not in str(site.at_edge.messages)

    await site.link.join()

    refusal = await site.at_central.result("pump", id="held-up", phase="rejected")
    assert refusal["code"] == "expired"
    await site.at_edge.result("pump", id="held-up", phase="rejected")
    assert site.at_edge.phases("held-up") == ["rejected"]


async def check_stopped(site: Bridged) -> None:
    """While the bridge's program is away telemetry waits at the edge, and a command is lost."""
    await settled(site)
    await asyncio.to_thread(site.place.stop_bridge)
    before = len(site.at_central.messages)
    await site.command("start", "while-away")
    await site.local("start")
    await asyncio.sleep(AWAY_S)
    await site.local("stop")
    assert len(site.at_central.messages) - before <= 2  # the notice, and the start itself

    await asyncio.to_thread(site.place.start_bridge)

    await settled(site)
    assert "while-away" not in str(site.at_edge.messages)


async def check_complete(site: Bridged) -> None:
    """Every numbered message of the edge is at the central broker, the same to the byte."""
    await settled(site)
    edge, central = site.at_edge.numbered(), site.at_central.numbered()
    assert len(edge) > 50
    assert {name: central.get(name) for name in edge} == edge


async def commands_pass(site: Bridged) -> None:
    """Wait until a stop comes through: one that is sent while the bridge connects again is lost."""
    for number in range(20):
        id_ = f"passes-{time.monotonic_ns()}-{number}"
        await site.command("stop", id_)
        with suppress(AssertionError):
            for place in (site.at_central, site.at_edge):
                await place.until("result/pump/dispatch", within_s=5.0, id=id_, phase="confirmed")
            return
    raise AssertionError("no stop comes through")


async def notice(site: Bridged, payload: str) -> None:
    """Wait until the newest notice of the bridge at the central broker is this."""

    def newest() -> list[str]:
        return [text for topic, text in site.at_central.messages if topic.endswith("/bridge")][-1:]

    await until(lambda: newest() == [payload], f"the notice {payload}")


async def settled(site: Bridged) -> None:
    """Wait until the central broker has had the newest that the edge had a moment ago."""
    await asyncio.sleep(0.5)
    wanted = site.at_edge.numbered()
    await until(lambda: wanted.keys() <= site.at_central.numbered().keys(), "the central broker has it all")
