"""A start that its way holds up is never taken late: stalled connections, a bridge, a last will."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from gateway.mqtt.connection.reconnect import Version
from tests.clients_page import example
from tests.mosquitto import MosquittoBroker, StartMosquitto, Watcher
from tests.mqtt.rig import MqttRig, settings
from tests.mqtt.stalling_relay import StallingRelay

START = "b/command/pump-1/alice/start"
FRESH = "b/gateway/fresh"
TTL_S = 2.0
SHORT_S, LONG_S = 0.3, 2.5  # a token is up to a second old when it is sent


class Sight:
    """What a client knows: the newest token that has reached it."""

    def __init__(self, watcher: Watcher) -> None:
        self._watcher = watcher
        self._token = ""

    async def proof(self) -> dict[str, Any]:
        while not self._token or self._watcher.has_more():
            await self._next()
        return {"token": self._token, "ttl_s": TTL_S}

    async def newest_proof(self) -> dict[str, Any]:
        """Wait for a token that comes from now on: it is not half as old as it may be."""
        await self.proof()
        await self._next()
        return await self.proof()

    async def _next(self) -> None:
        seen = await self._watcher.next()
        self._token = json.loads(seen.payload)["token"]


def command(id_: str, **fields: Any) -> str:
    return json.dumps({"id": id_, **fields})


async def verdicts(rig: MqttRig, count: int) -> list[str]:
    return [await rig.verdict() for _ in range(count)]


@pytest.mark.parametrize("version", [Version.V5, Version.V311])
@pytest.mark.parametrize(("stalled_s", "verdict"), [(SHORT_S, "fresh"), (LONG_S, "expired")])
async def test_a_start_that_stood_between_broker_and_gateway(
    start_mosquitto: StartMosquitto, version: Version, stalled_s: float, verdict: str
) -> None:
    broker = start_mosquitto()
    async with (
        StallingRelay(broker.port) as relay,
        MqttRig(settings(relay.port, version=version)) as rig,
        broker.watch(FRESH) as watcher,
    ):
        await rig.until_connected()
        proof = await Sight(watcher).newest_proof()
        relay.stall(down=True)
        await asyncio.to_thread(broker.publish, START, command("1", **proof, boot="boot-1"))
        await asyncio.to_thread(broker.publish, START, command("2", boot="boot-1"))
        await asyncio.sleep(stalled_s)
        relay.go_on()

        assert await verdicts(rig, 2) == [verdict, "not_fresh"]
        assert rig.boot.token == "boot-1"  # no one has noticed anything


@pytest.mark.parametrize("version", [Version.V5, Version.V311])
async def test_a_start_by_what_reached_the_client_while_the_gateways_way_up_stood_still(
    start_mosquitto: StartMosquitto, version: Version
) -> None:
    broker = start_mosquitto()
    async with (
        StallingRelay(broker.port) as relay,
        MqttRig(settings(relay.port, version=version)) as rig,
        broker.watch(FRESH) as watcher,
    ):
        await rig.until_connected()
        sight = Sight(watcher)
        await sight.proof()
        relay.stall(up=True)
        await asyncio.sleep(LONG_S + 1.0)
        old = await sight.proof()
        await asyncio.to_thread(broker.publish, START, command("1", **old))
        first = await rig.verdict()
        relay.go_on()
        await asyncio.sleep(1.0)
        await asyncio.to_thread(broker.publish, START, command("2", **await sight.newest_proof()))

        assert [first, await rig.verdict()] == ["expired", "fresh"]


@pytest.mark.parametrize("version", ["mqttv5", "mqttv311"])
async def test_a_start_that_stood_between_client_and_broker(
    start_mosquitto: StartMosquitto, version: str
) -> None:
    broker = start_mosquitto()
    async with (
        StallingRelay(broker.port) as relay,
        MqttRig(settings(broker.port)) as rig,
        broker.watch(FRESH) as watcher,
    ):
        await rig.until_connected()
        proof = await Sight(watcher).proof()
        relay.stall(up=True)
        publishing = asyncio.create_task(
            asyncio.to_thread(
                broker.publish, START, command("1", **proof, boot="boot-1"), "-V", version, port=relay.port
            )
        )
        await asyncio.sleep(LONG_S)
        relay.go_on()
        await publishing

        assert await rig.verdict() == "expired"


async def test_a_broker_that_was_stopped_gives_an_old_start_to_the_gateway_when_it_goes_on(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    async with MqttRig(settings(broker.port)) as rig, broker.watch(FRESH) as watcher:
        await rig.until_connected()
        proof = await Sight(watcher).proof()
        broker.stand_still()
        publishing = asyncio.create_task(
            asyncio.to_thread(broker.publish, START, command("1", **proof, boot="boot-1"))
        )
        await asyncio.sleep(LONG_S)
        broker.go_on()
        await publishing

        assert await rig.verdict() == "expired"
        assert rig.versions == [Version.V5]


def bridge(broker: MosquittoBroker, port: int) -> tuple[str, ...]:
    """Return the lines of a broker in another place, bridged with Mosquitto's defaults."""
    return (
        "connection plant",
        f"address 127.0.0.1:{port}",
        "topic b/command/# out 1",
        "topic b/gateway/# in 1",
        "restart_timeout 1",
    )


async def test_a_start_over_a_bridge_whose_link_was_cut(start_mosquitto: StartMosquitto) -> None:
    plant = start_mosquitto()
    async with StallingRelay(plant.port) as relay, MqttRig(settings(plant.port)) as rig:
        await rig.until_connected()
        office = start_mosquitto(options=bridge(plant, relay.port))
        async with office.watch(FRESH) as watcher:
            sight = Sight(watcher)
            await asyncio.to_thread(office.publish, START, command("1", **await sight.newest_proof()))
            through = await rig.verdict()
            proof = await sight.proof()
            relay.stall(up=True, down=True)
            await asyncio.to_thread(office.publish, START, command("2", **proof, boot="boot-1"))
            await asyncio.to_thread(office.publish, START, command("3", boot="boot-1"))
            await asyncio.sleep(LONG_S)
            relay.go_on()
            late = sorted(await verdicts(rig, 2))

    assert through == "fresh"
    assert late == ["expired", "not_fresh"]


async def test_the_example_for_mosquitto_pub_sends_a_fresh_start_and_a_stop(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    lines = [line for line in example("sh").splitlines() if "/result/" not in line]
    script = "\n".join(lines).replace("B=starters/mcc1", "B=b")
    for program in ("mosquitto_sub", "mosquitto_pub"):
        script = script.replace(f"{program} ", f"{program} -p {broker.port} ")
    async with MqttRig(settings(broker.port)) as rig:
        await rig.until_connected()
        shell = await asyncio.create_subprocess_exec("sh", "-c", script)
        judged = await verdicts(rig, 2)

        assert await shell.wait() == 0
        assert judged == ["fresh", "fresh"]


async def test_an_operators_last_will_starts_nothing(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto()
    async with MqttRig(settings(broker.port)) as rig, broker.watch(FRESH) as watcher:
        await rig.until_connected()
        proof = await Sight(watcher).proof()
        wills = [command("1", boot="boot-1"), command("2", **proof, boot="boot-1")]
        clients = [await broker.leave_will(START, will) for will in wills]
        await asyncio.sleep(LONG_S)
        for client in clients:
            client.kill()
            await client.wait()

        assert sorted(await verdicts(rig, 2)) == ["expired", "not_fresh"]
