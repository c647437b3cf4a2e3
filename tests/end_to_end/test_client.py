"""The client for integrators against a real Mosquitto; the gateway's part is played here."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from gateway.client import Client, Result
from gateway.contract import FreshRecord, Phase, ResultCode, ResultRecord, StatusRecord, Topics
from gateway.errors import NoResultError, UsageError
from tests.mosquitto import MosquittoBroker, StartMosquitto, Watcher

TOPICS = Topics("starters/mcc1")
NOW_S = 1_795_222_923.0


class PlayedGateway:
    """Says that it is online, and answers as reported."""

    def __init__(self, broker: MosquittoBroker, watcher: Watcher) -> None:
        self._broker = broker
        self._watcher = watcher

    @staticmethod
    def come_online(broker: MosquittoBroker) -> None:
        status = StatusRecord(
            state="online", time_s=NOW_S, boot="boot-1", since_s=NOW_S, reason=None, run="run"
        )
        for record in (FreshRecord(token="token-1", time_s=NOW_S), status):
            broker.publish(TOPICS.of(type(record)), record.payload().decode(), "-r")

    async def command(self) -> tuple[str, dict[str, Any]]:
        """Return the next command: its topic and payload."""
        seen = await self._watcher.next()
        assert not seen.retain
        body: dict[str, Any] = json.loads(seen.payload)
        return seen.topic, body

    async def answer(
        self,
        id_: str,
        phase: Phase,
        code: ResultCode = ResultCode.OK,
        *,
        is_duplicate: bool = False,
        **more: Any,
    ) -> None:
        record = ResultRecord(
            starter="pump-1",
            client="alice",
            id=id_,
            verb="x",
            phase=phase,
            code=code,
            text="said",
            time_s=NOW_S,
            is_duplicate=is_duplicate,
            values=more,
        )
        topic = f"{TOPICS.base}/{record.topic}"
        await asyncio.to_thread(self._broker.publish, topic, record.payload().decode())


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
        await gateway.answer(body["id"], Phase.ACCEPTED)
        await gateway.answer("another's", Phase.CONFIRMED)
        await gateway.answer(body["id"], Phase.WRITTEN)
        await gateway.answer(body["id"], Phase.CONFIRMED, state="running")
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
        await gateway.answer(second["id"], Phase.UNCONFIRMED, ResultCode.CRASHED, is_duplicate=True)
        result = await asking

    assert first["id"] == second["id"] == result.id
    assert (result.is_duplicate, result.is_confirmed, result.may_have_acted) == (True, False, True)
    assert "look at the starter" in str(unknown.value)


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
