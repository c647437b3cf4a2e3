"""deploy/contrib/postgresql: each message is in the table once and in order, whatever fails."""

from __future__ import annotations

import asyncio
import json
import os
import random
import re
import runpy
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from paho.mqtt import client as paho

from tests.end_to_end.database import Database, database, programs
from tests.end_to_end.plant import STARTERS
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.listener import BrokerListener
from tests.mosquitto import StartMosquitto

pytest.importorskip("pg8000")
BIN = programs()
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(BIN is None, reason="PostgreSQL is not installed (apt-get install postgresql)"),
]

CONTRIB = Path(__file__).parents[2] / "deploy" / "contrib" / "postgresql"
BASE = "acme/site1/area/line3/mcc1"  # of a unified namespace
WITHIN_S = 15.0
FOREIGN = "no JSON"  # from another program
KINDS = ("value/+", "state", "alarm/+", "event", "start", "trip", "history")
TOPICS = ("gateway/event", "audit", "result/+/+", *(f"starter/+/{kind}" for kind in KINDS))


class Consumer:
    """The consumer as a process that can be killed and started again."""

    def __init__(self, *arguments: str, database: Database, log: Path) -> None:
        self._command = [sys.executable, str(CONTRIB / "consumer.py"), *arguments]
        self._environ = {**os.environ, **database.environ}
        self.log = log
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with self.log.open("ab") as log:
            self._process = subprocess.Popen(
                self._command, env=self._environ, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait(WITHIN_S)
            self._process = None


@pytest.fixture
def server() -> Iterator[Database]:
    assert BIN is not None
    with database(BIN) as made:
        made.run((CONTRIB / "schema.sql").read_text("utf-8"))
        yield made


class Witness(BrokerListener):
    """A subscriber that is never killed, there before anything is retained; `named` is what it gets."""

    def __init__(self, port: int) -> None:
        super().__init__(port, f"{BASE}/#", "witness")
        self.named: list[tuple[Any, ...]] = []

    def take(self, message: paho.MQTTMessage) -> None:
        is_asked = any(paho.topic_matches_sub(f"{BASE}/{each}", message.topic) for each in TOPICS)
        if is_asked and not message.retain and message.payload != FOREIGN.encode():
            self.named += names_of(message.topic, json.loads(message.payload))


def names_of(topic: str, body: dict[str, Any]) -> list[tuple[Any, ...]]:
    """Return what names a message: of one with late values, of each."""
    if topic.endswith("/history"):
        branch = topic.removesuffix("history")
        return [(f"{branch}value/{item['point']}", body["boot"], item["seq"]) for item in body["items"]]
    if "seq" in body:
        return [(topic, body["boot"], body["seq"])]
    return [(topic, body["id"] or "", body["phase"], body["duplicate"])]


def names_in(server: Database) -> Counter[tuple[Any, ...]]:
    messages = server.run("SELECT topic, boot, seq FROM message")
    results = server.run("SELECT topic, id, phase, duplicate FROM result")
    return Counter(tuple(row) for row in (*messages, *results))


def wait_until_settled(server: Database, witness: Witness) -> None:
    """Wait until the table has what the witness has seen, at most for WITHIN_S."""
    until_s = time.monotonic() + WITHIN_S
    while time.monotonic() < until_s:
        time.sleep(0.5)
        if set(witness.named) == names_in(server).keys():
            return


async def test_each_message_is_in_the_table_once_and_in_order_whatever_fails(
    start_mosquitto: StartMosquitto, server: Database, tmp_path: Path
) -> None:
    broker = start_mosquitto(is_persistent=True, options=["max_queued_messages 10000"])
    text = site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL"))
    config = write_config(tmp_path, text.replace("[mqtt]\n", f'[mqtt]\nbase = "{BASE}"\n'))
    consumer = Consumer(
        *("--port", str(broker.port), "--base", "acme/+/+/+/mcc1"), database=server, log=tmp_path / "log"
    )
    consumer.start()
    witness = Witness(broker.port)
    witness.start()
    async with (
        Program("gateway", "simulate", str(config)) as simulator,
        Scada(broker.port, base=BASE) as scada,
    ):
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway:
            for starter in STARTERS:
                await scada.ready(starter)
            await scada.command("fan", "start", "one")
            for _ in range(3):
                await asyncio.sleep(0.3)
                consumer.kill()
                consumer.start()
            server.crash()
            async with Program("gateway", "send", str(config), "pump", "start", "--client", "alice") as sent:
                assert await sent.exit_code() == 0, sent.output
            server.start()
            broker.stop()
            await asyncio.sleep(1.0)  # the motors run: values of this time come late
            broker.start()
            scada.latest.clear()
            await scada.until("gateway/status", state="online")
            await asyncio.sleep(0.5)
            gateway.signal(signal.SIGKILL)
            await gateway.exit_code()
        async with Program("gateway", "run", str(config)) as gateway:
            await scada.until("starter/pump/state", state="running", quality="good")
            consumer.kill()
            server.crash()
            broker.restart()
            async with Program("gateway", "watch", broker.url, "--base", "acme/+/+/+/+") as table:
                assert await table.exit_code() == 0, table.output
            assert f"{BASE}  online  LIVE" in table.output
            server.start()
            consumer.start()
            scada.say("command/pump/alice/stop")
            await scada.until("starter/pump/state", state="ready", quality="good")
            scada.say("starter/pump/state", FOREIGN)
            gateway.signal(signal.SIGTERM)
            assert await gateway.exit_code() == 0
        await asyncio.to_thread(wait_until_settled, server, witness)
    consumer.kill()
    witness.stop()

    named = witness.named
    assert names_in(server) == Counter(set(named)), consumer.log.read_text("utf-8")
    assert len(named) > len(set(named))  # the broker did repeat some
    assert server.run("SELECT payload FROM unreadable") == [[FOREIGN.encode()]]
    assert server.run("SELECT count(*) FROM reading WHERE unit IS NULL") != [[0]]  # they came late
    runs = list(dict.fromkeys(name[1] for name in named if len(name) == 3))
    assert [row[0] for row in server.run("SELECT boot FROM run ORDER BY began")] == runs
    assert len(runs) == 2
    for run in runs:  # numbers that are missing: states that newer ones replaced while the broker was away
        numbers = {row[0] for row in server.run(f"SELECT seq FROM message WHERE boot = '{run}'")}
        assert len(numbers) > 100
        assert len(set(range(1, max(numbers))) - numbers) <= 8 * len(STARTERS)
    assert not server.run(BACKWARDS)


POISON = [  # none of them may hold up what comes after it
    b"no JSON",
    b"\xff",
    b"[]",
    b"7",
    b'{"seq":1}',
    b'{"seq":1,"boot":null,"time":null}',
    b'{"seq":"x","boot":"r","time":null}',
    b'{"seq":1,"boot":"r","time":"soon"}',
    b'{"seq":1,"boot":"r","time":null,"text":"\\u0000"}',
    b'{"seq":1,"boot":"r","time":null,"text":"\\ud800"}',
    b'{"seq":1,"boot":"r","time":null,"value":NaN}',
    b'{"seq":99999999999999999999,"boot":"r","time":null}',
    b"[" * 100_000,
    b'{"seq":1,"boot":"'
    + random.Random(5).randbytes(6000).hex().encode()
    + b'","time":null}',  # for an index
]


@pytest.fixture
def store(server: Database, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Give what the consumer writes with."""
    for name, value in server.environ.items():
        monkeypatch.setenv(name, value)
    made = runpy.run_path(str(CONTRIB / "consumer.py"))["Store"]()
    yield made
    made._close()


def test_what_is_no_message_of_ours_is_put_aside_and_holds_up_nothing(server: Database, store: Any) -> None:
    good = [f'{{"seq":{seq},"boot":"run","time":null}}'.encode() for seq in (1, 2)]
    batch = [SimpleNamespace(topic="b/starter/p/state", payload=each) for each in (good[0], *POISON, good[1])]

    assert store.write(batch)
    assert store.write(batch)

    assert names_in(server) == Counter([("b/starter/p/state", "run", 1), ("b/starter/p/state", "run", 2)])
    assert Counter(row[0] for row in server.run("SELECT payload FROM unreadable")) == Counter(POISON)


def test_the_tables_for_timescale_take_the_same_messages_once(server: Database, store: Any) -> None:
    lines = (CONTRIB.parent / "timescaledb" / "fleet.sql").read_text("utf-8").splitlines()
    server.run("\n".join(line for line in lines if not line.endswith("; -- timescale")))
    value = {"boot": "run", "value": 1.0, "unit": "A", "quality": "good", "time": "2026-11-21T01:02:03.456Z"}
    bodies = [{**value, "seq": 1}, {**value, "seq": 2, "time": None}]  # the second was never read
    topic = "b/starter/p/value/current"
    batch = [SimpleNamespace(topic=topic, payload=json.dumps(each).encode()) for each in bodies]

    assert store.write([*batch, *batch])
    assert store.write(batch)

    assert names_in(server) == Counter([(topic, "run", 1), (topic, "run", 2)])
    assert server.run("SELECT seq FROM message WHERE time IS NULL") == [[2]]
    assert server.run("SELECT number FROM reading ORDER BY seq") == [[1.0], [1.0]]


def test_the_statements_for_emqx_write_a_row_once(server: Database) -> None:
    texts = (CONTRIB.parent / "emqx" / "rules.sql").read_text("utf-8").split("-- action")[1:]
    message, result = (text.partition("\n")[2].partition("\n\n")[0] for text in texts)
    time_ = "2026-11-21T01:02:03.456Z"
    row = {
        "topic": "b/starter/p/state",
        "boot": "r",
        "seq": "7",
        "time": time_,
        "quality": "good",
        "payload": "{}",
    }
    phase = {"topic": "b/result/p/c", "id": "", "phase": "confirmed", "duplicate": "false", "time": time_}

    for _ in range(2):
        for text, fields in ((message, row), (result, {**phase, "payload": "{}"})):
            server.run(re.sub(r"\$\{(\w+)\}", lambda found, fields=fields: f"'{fields[found[1]]}'", text))

    assert names_in(server) == Counter([(row["topic"], "r", 7), ("b/result/p/c", "", "confirmed", False)])
    assert server.run("SELECT boot FROM run") == [["r"]]


# A value that was read before the one that stands before it.
BACKWARDS = """
SELECT * FROM (
    SELECT *, lag(time) OVER (PARTITION BY base, starter, point ORDER BY began, seq) AS before
    FROM reading WHERE quality = 'good'
) AS ordered WHERE time < before"""
