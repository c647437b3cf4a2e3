"""The client for integrators against a real Mosquitto; the gateway's part is played here."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from gateway.client import Client, Result
from gateway.contract import Topics, encoded
from gateway.errors import BrokerError, NoResultError, UsageError
from tests.mosquitto import MosquittoBroker, StartMosquitto, Watcher, free_port

TOPICS = Topics("starters/mcc1")


class PlayedGateway:
    """Says that it is online, and answers as reported."""

    def __init__(self, broker: MosquittoBroker, watcher: Watcher) -> None:
        self._broker = broker
        self._watcher = watcher

    @staticmethod
    def come_online(broker: MosquittoBroker, state: str = "online") -> None:
        broker.publish(TOPICS.gateway_fresh, json.dumps({"token": "token-1", "time": "2026Z"}), "-r")
        broker.publish(TOPICS.gateway_status, json.dumps({"state": state, "boot": "boot-1"}), "-r")

    async def command(self) -> tuple[str, dict[str, Any]]:
        """Return the next command: its topic and payload."""
        seen = await self._watcher.next()
        assert not seen.retain
        body: dict[str, Any] = json.loads(seen.payload)
        return seen.topic, body

    async def answer(self, id_: str, phase: str, code: str = "ok", **more: Any) -> None:
        fields = {"id": id_, "verb": "x", "phase": phase, "code": code, "text": "said", "time": "2026Z"}
        payload = encoded({**fields, "duplicate": False, **more})
        await asyncio.to_thread(self._broker.publish, TOPICS.result("pump-1", "alice"), payload)


def client(broker: MosquittoBroker, **options: Any) -> Client:
    return Client(broker.url, base="starters/mcc1", client="alice", operator="Alice A.", **options)


async def test_a_command_is_fresh_and_followed_to_its_end(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto()
    PlayedGateway.come_online(broker)
    phases: list[Result] = []
    async with broker.watch(TOPICS.command_filter) as watcher:
        gateway = PlayedGateway(broker, watcher)
        command = client(broker).command(
            "pump-1",
            "start",
            reason="as agreed",
            expect={"state": "ready"},
            select="token",
            ttl_s=3.0,
            on_phase=phases.append,
        )
        asking = asyncio.create_task(command)
        topic, body = await gateway.command()
        await gateway.answer(body["id"], "accepted")
        await gateway.answer("another's", "confirmed")
        await gateway.answer(body["id"], "written")
        await gateway.answer(body["id"], "confirmed", state="running")
        result = await asking

    assert topic == "starters/mcc1/command/pump-1/alice/start"
    assert body.pop("issued_at").endswith("Z")
    assert body.pop("id") == result.id
    assert body == {
        "boot": "boot-1",
        "token": "token-1",
        "operator": "Alice A.",
        "reason": "as agreed",
        "ttl_s": 3.0,
        "expect": {"state": "ready"},
        "select": "token",
        "args": {},
    }
    assert [phase.phase for phase in phases] == ["accepted", "written"]
    assert phases[1].may_have_acted
    assert (result.is_confirmed, result.may_have_acted, result.is_duplicate) == (True, False, False)
    assert result.values == {"state": "running"}
    assert result.what_to_do == "Nothing."


async def test_a_command_sent_again_by_its_id_gets_the_stored_result(start_mosquitto: StartMosquitto) -> None:
    broker = start_mosquitto()
    PlayedGateway.come_online(broker)
    async with broker.watch(TOPICS.command_filter) as watcher:
        gateway = PlayedGateway(broker, watcher)
        with pytest.raises(NoResultError) as unknown:
            await client(broker).command("pump-1", "start", within_s=0.1)
        _, first = await gateway.command()
        asking = asyncio.create_task(client(broker).command("pump-1", "start", id_=unknown.value.id))
        _, second = await gateway.command()
        await gateway.answer(second["id"], "unconfirmed", "crashed", duplicate=True)
        result = await asking

    assert first["id"] == second["id"] == result.id
    assert (result.is_duplicate, result.is_confirmed, result.may_have_acted) == (True, False, True)
    assert "look at the starter" in str(unknown.value)


@pytest.mark.parametrize("state", ["offline", None])
async def test_a_stop_goes_out_even_when_no_gateway_seems_to_be_there(
    start_mosquitto: StartMosquitto, state: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.mqtt.connection.command_client.TROUBLED_WITHIN_S", 0.1)
    broker = start_mosquitto()
    if state is not None:
        PlayedGateway.come_online(broker, state)
    async with broker.watch(TOPICS.command_filter) as watcher:
        with pytest.raises(BrokerError, match="the stop was sent, and no gateway answered"):
            await client(broker).stop("pump-1")
        topic, body = await PlayedGateway(broker, watcher).command()

    assert topic == "starters/mcc1/command/pump-1/alice/stop"
    assert "boot" not in body


async def test_a_connection_lost_after_the_command_leaves_its_end_unknown(
    start_mosquitto: StartMosquitto,
) -> None:
    broker = start_mosquitto()
    PlayedGateway.come_online(broker)
    async with broker.watch(TOPICS.command_filter) as watcher:
        asking = asyncio.create_task(client(broker).start("pump-1"))
        _, body = await PlayedGateway(broker, watcher).command()
        broker.kill()

        with pytest.raises(NoResultError, match="was lost before the final result") as unknown:
            await asking

    assert unknown.value.id == body["id"]


async def test_a_broker_that_is_away_means_that_nothing_was_sent() -> None:
    absent = Client(f"mqtt://127.0.0.1:{free_port()}", base="starters/mcc1", client="alice")

    for verb in ("start", "stop"):
        with pytest.raises(BrokerError, match="nothing listens there"):
            await absent.command("pump-1", verb)


@pytest.mark.parametrize(
    ("url", "base", "name"),
    [
        ("http://broker", "starters/mcc1", "alice"),
        ("mqtt://", "starters/mcc1", "alice"),
        ("mqtt://broker", "starters/mcc1", "Alice"),
        ("mqtt://broker", "acme//mcc1", "alice"),
        ("mqtt://broker", "acme/+/mcc1", "alice"),
    ],
)
def test_an_unfit_url_base_or_client_is_refused_at_once(url: str, base: str, name: str) -> None:
    with pytest.raises(UsageError):
        Client(url, base=base, client=name)
