"""What waits for the broker outlives SIGKILL."""

from __future__ import annotations

import asyncio
import json
import random
import signal
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from gateway.storage.database import Database
from gateway.storage.outbox import FILE
from gateway.storage.outbox_table import HIGHEST, OutboxTable
from gateway.storage.spool import Kind
from tests.end_to_end.killed_writer import write_until_killed
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.mosquitto import StartMosquitto

KILLS = 12
LONGEST_S = 0.15


def texts_of(folder: Path) -> list[str]:
    """Return what is in the file, in its order; it must open without anything being put aside."""
    table = OutboxTable()
    database = Database(folder / FILE, [table], 2**26)
    assert database.open() == ""
    rows = []
    for kind in (Kind.VALUE, Kind.EVENT):
        (page,) = database.transact(
            [lambda c, k=kind: table.page(c, kind=k, after=-1, before=HIGHEST, most=10**6)]
        )
        assert page.losses == ()
        rows += page.rows
    database.close()
    return [row.payload.decode() for row in sorted(rows)]


def test_no_row_that_was_stored_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    dice = random.Random(21)
    stored: list[str] = []
    for kill in range(KILLS):
        stored += write_until_killed("outbox_writer", tmp_path, kill, dice, LONGEST_S)

        found, published = texts_of(tmp_path), set(stored)

        assert len(found) == len(set(found))
        assert [text for text in found if text in published] == stored
    assert len(stored) > 20 * KILLS


async def test_what_happened_without_a_broker_is_published_after_a_kill(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    config = write_config(tmp_path, site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL")))
    async with Program("gateway", "simulate", str(config)) as simulator:
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway:
            async with broker.watch("starters/plant/#") as w:
                run = (await Scada(broker, w).until("gateway/status", state="online"))["run"]
            broker.stop()
            await until_stored(tmp_path / "state")
            gateway.signal(signal.SIGKILL)
            await gateway.exit_code()
        broker.start()
        async with broker.watch("starters/plant/#") as w, Program("gateway", "run", str(config)):
            published = await until_published(w, run)

    assert published["event"]["code"] == "broker_away"
    assert len(published["items"]) > 0
    assert all(item["seq"] > 0 for item in published["items"])


async def until_stored(folder: Path) -> None:
    """Wait until the loss of the broker, and a value from then, are in the file of a gateway that runs."""
    async with asyncio.timeout(20.0):
        while True:
            with closing(sqlite3.connect(f"file:{folder / FILE}?mode=ro", uri=True)) as file:
                rows = file.execute("SELECT kind, payload FROM spool").fetchall()
            kinds = {kind for kind, payload in rows if kind == Kind.VALUE or b"broker_away" in payload}
            if kinds == {Kind.VALUE, Kind.EVENT}:
                return
            await asyncio.sleep(0.1)


async def until_published(watcher: Any, run: str) -> dict[str, Any]:
    """Wait until an earlier run's loss of the broker, and values from then, are published."""
    published: dict[str, Any] = {"items": []}
    async with asyncio.timeout(15.0):
        while "event" not in published or not published["items"]:
            seen = await watcher.next()
            if seen.topic.endswith(("gateway/event", "/history")):
                message = json.loads(seen.payload)
                if message["boot"] == run and message.get("code") == "broker_away":
                    published["event"] = message
                elif message["boot"] == run:
                    published["items"] += message.get("items", [])
    return published
