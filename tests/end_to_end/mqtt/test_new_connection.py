"""What comes while a connection is being made: a stop acts at once, a start is judged by the connection."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gateway.records import rfc3339
from tests.end_to_end.site import PUMP, Program, site_config, write_config
from tests.mqtt.fake_broker import ACCEPT_5, ACCEPT_311, LEVEL_5, LEVEL_311, REFUSE_VERSION, FakeBroker
from tests.rig.sites import operator

STARTER = PUMP + operator("alice", freshness="issued_at")
STOP_FRAME = ">> 01 05 00 64 00 00"
both_versions = pytest.mark.parametrize("level", [LEVEL_5, LEVEL_311])


def spoken(level: int) -> dict[int, bytes | None]:
    """Return the answers of a broker that speaks this version of MQTT."""
    return {LEVEL_5: ACCEPT_5 if level == LEVEL_5 else REFUSE_VERSION, LEVEL_311: ACCEPT_311}


def command(level: int, verb: str, payload: bytes = b"") -> bytes:
    """Return the packet that brings a command to the gateway."""
    topic = f"starters/plant/command/pump/alice/{verb}".encode()
    body = len(topic).to_bytes(2, "big") + topic + (b"\x00" if level == LEVEL_5 else b"") + payload
    size = len(body)
    return bytes([0x30, *([size] if size < 0x80 else [size % 0x80 | 0x80, size // 0x80])]) + body


def start(level: int, id_: str) -> bytes:
    """Return a start that was issued just now."""
    body = {"id": id_, "issued_at": rfc3339(time.time()), "ttl_s": 60}
    return command(level, "start", json.dumps(body).encode())


@asynccontextmanager
async def gateway_at(broker: FakeBroker, folder: Path) -> AsyncIterator[Program]:
    """Run the gateway with a simulated starter."""
    text = site_config(broker_port=broker.port, port=str(folder / "ttyHALL"), starters=STARTER)
    config = write_config(folder, text.replace("[gateway]", '[gateway]\nclock = "trusted"'))
    async with Program("gateway", "simulate", str(config)) as simulator:
        await simulator.says("line hall")
        async with Program("gateway", "run", "-v", str(config)) as gateway:
            yield gateway


async def refusal(broker: FakeBroker, id_: str) -> str:
    """Return the code of a command's refusal."""
    async with asyncio.timeout(20.0):
        while True:
            packet = await broker.publication()
            _, brace, rest = packet.body.partition(b"{")
            body = json.loads(brace + rest) if packet.topic.startswith("starters/plant/result/") else {}
            if body.get("id") == id_ and body["phase"] == "rejected":
                return str(body["code"])


@both_versions
async def test_a_stop_waits_for_no_answer_to_the_subscription(level: int, tmp_path: Path) -> None:
    """It may be late, and is lost with the connection; what is held back until then would be too."""
    stop = command(level, "stop")
    async with (
        FakeBroker(answers=spoken(level), answers_subscriptions=False, before_suback=stop) as broker,
        gateway_at(broker, tmp_path) as gateway,
    ):
        await gateway.says(STOP_FRAME)


@both_versions
async def test_a_start_that_comes_with_the_answer_to_the_subscription_is_judged_by_the_connection(
    level: int, tmp_path: Path
) -> None:
    """Held up until then, it may be older than a stop that no gateway was there to take."""
    async with (
        FakeBroker(answers=spoken(level), before_suback=start(level, "first")) as broker,
        gateway_at(broker, tmp_path) as gateway,
    ):
        codes = [await refusal(broker, "first")]
        broker.before_suback, broker.after_suback = b"", start(level, "second")
        broker.hang_up()
        codes.append(await refusal(broker, "second"))

    assert codes == ["before_connection", "before_connection"]
    assert "05 00 64 ff 00" not in gateway.output


@both_versions
async def test_what_comes_before_the_connection_is_accepted_stops_or_is_refused(
    level: int, tmp_path: Path
) -> None:
    """No broker may do that [MQTT5 3.2]; what another device on its port sends starts nothing."""
    answers = spoken(level)
    answers[level] = start(level, "early") + command(level, "stop") + (answers[level] or b"")
    async with FakeBroker(answers=answers) as broker, gateway_at(broker, tmp_path) as gateway:
        assert await refusal(broker, "early") == "before_connection"
        await gateway.says(STOP_FRAME)
