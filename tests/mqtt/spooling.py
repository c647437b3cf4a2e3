"""A gateway's outbox with its real file, in virtual time: the disk answers at once, or not at all."""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any

from gateway.errors import StoreError
from gateway.mqtt.contract.payloads import LateValue, Message
from gateway.mqtt.outbox.disk_sync import DiskSync
from gateway.mqtt.outbox.outbox import Outbox, Outgoing
from gateway.records import Severity
from gateway.storage.database import Connection
from gateway.storage.outbox import FILE, OutboxDisk
from gateway.storage.worker import OnNews, Store, _Piece
from tests.virtual_time import VirtualClock

STATUS = "b/gateway/status"
PROMPT_S = 0.001  # until the broker acknowledges


class InlineStore(Store):
    """The real store without its thread; `hang` keeps what is submitted from being done."""

    is_hanging = False
    is_failing = False

    def start(self, on_news: OnNews) -> None:
        self._on_news = on_news
        self.retry()

    def retry(self) -> None:
        """Do what the thread does after each pause."""
        self._retry_s = 0.0
        self._serve([])

    @property
    def trouble(self) -> str:
        return "the disk hangs" if self.is_hanging else super().trouble

    def submit(self, work: Callable[[Connection], Any], *, is_flushed: bool = True) -> Future[Any]:
        piece = _Piece(work, is_flushed)
        if self.is_failing:
            piece.future.set_exception(StoreError("the disk fails"))
        elif not self.is_hanging:
            self._serve([piece])
        return piece.future

    def close(self, *, within_s: float) -> bool:
        self._file.close()
        return not self.is_hanging


class InlineDisk(OutboxDisk):
    """The real disk on a store without a thread."""

    async def close(self, within_s: float) -> bool:
        return self._store.close(within_s=within_s)


def pack(topic: str, items: Sequence[str], boot: str) -> Message:
    payload = f'{{"boot":"{boot}","items":[{",".join(items)}]}}'.encode()
    return Message(topic, payload, qos=1, retain=False, is_queued=True, is_droppable=True)


def value(number: int, *, starter: str = "p", point: str = "a") -> Message:
    payload = str(number).encode()
    return Message(f"b/{starter}/value/{point}", payload, qos=1, retain=True, is_value=True)


def late(message: Message) -> LateValue:
    return LateValue(f"{message.topic.rpartition('/value/')[0]}/history", message.payload)


def event(number: int) -> Message:
    return Message("b/event", str(number).encode(), qos=1, retain=False, is_queued=True, is_droppable=True)


def result(number: int, key: str = "") -> Message:
    return Message("b/result", str(number).encode(), qos=1, retain=False, is_queued=True, key=key)


class SpoolRun:
    """One run of a gateway; `kill` ends it as SIGKILL does. Made and used within virtual time."""

    def __init__(self, folder: Path, boot: str, *, most_rows: int = 400_000, max_bytes: int = 2**26) -> None:
        self.path = folder / FILE
        self.loop = asyncio.get_running_loop()
        self.clock = VirtualClock(self.loop)
        self.outbox = Outbox(last_topic=STATUS, pack=pack, late=late, boot=boot)
        self.disk = InlineDisk(folder, most_rows=most_rows, max_bytes=max_bytes, retry_s=0.0)
        store = self.disk._store
        assert isinstance(store, InlineStore)
        self.store = store
        self.disk_sync = DiskSync(
            self.outbox, self.disk, clock=self.clock, publish_event=self._publish_event, wake=self._deliver
        )
        self.events: list[tuple[str, Mapping[str, Any]]] = []
        self.reported: list[tuple[float, Message]] = []  # what the broker has had, and when
        self.refuses: Callable[[Message], bool] = lambda message: False
        self.acknowledges = True
        self.tasks = [asyncio.create_task(work()) for work in (self.disk_sync.run, self.disk_sync.pace)]

    async def begin(self) -> SpoolRun:
        """Start, and wait until it is known what was left behind."""
        self.disk_sync.start()
        await asyncio.sleep(0.3)
        return self

    def put(self, *messages: Message) -> None:
        for message in messages:
            self.outbox.put(message, self.clock.now_s())
        self._deliver()

    def connect(self, window: int = 20) -> None:
        self.outbox.connected(window)
        self._deliver()

    def disconnect(self) -> None:
        self.outbox.disconnected()

    def kill(self) -> None:
        """End without another word; the file is let go of as the kernel would."""
        for task in self.tasks:
            task.cancel()
        self.outbox.disconnected()
        self.store._file.close()

    async def end(self) -> None:
        """End in order."""
        await self.disk_sync.close(within_s=2.0)
        self.kill()

    def texts(self, topic: str = "") -> list[str]:
        """Return what the broker has had, with its topics without the base when none is given."""
        reported = [message for _, message in self.reported]
        if topic:
            return [message.payload.decode() for message in reported if message.topic == f"b/{topic}"]
        return [f"{message.topic[2:]}={message.payload.decode()}" for message in reported]

    def items(self, starter: str = "p", boot: str | None = None) -> list[int]:
        """Return the values that were reported late."""
        batches = [json.loads(text) for text in self.texts(f"{starter}/history")]
        return [item for each in batches if boot in (None, each["boot"]) for item in each["items"]]

    def codes(self) -> list[str]:
        return [code for code, _ in self.events]

    def lost(self) -> dict[str, int]:
        """Return how much was declared lost, by kind."""
        lost: dict[str, int] = {}
        for code, data in self.events:
            for each in data["lost"] if code == "gap" else ():
                lost[each["kind"]] = lost.get(each["kind"], 0) + each["count"]
        return lost

    def memory_rows(self) -> int:
        return sum(len(lane) for lane in self.outbox.backlog._segments)

    def _publish_event(self, code: str, severity: Severity, text: str, data: Mapping[str, Any]) -> None:
        self.events.append((code, data))

    def _deliver(self) -> None:
        while (outgoing := self.outbox.take()) is not None:
            self.reported.append((self.loop.time(), outgoing.message))
            if self.acknowledges:
                self.loop.call_later(PROMPT_S, self._acknowledge, outgoing)

    def _acknowledge(self, outgoing: Outgoing) -> None:
        self.outbox.acked(outgoing.ticket, 0x87 if self.refuses(outgoing.message) else 0)
        self._deliver()


def on_disk(folder: Path, columns: str = "number", table: str = "spool") -> list[tuple[Any, ...]]:
    """Return what is in the file of a run that has ended."""
    with closing(sqlite3.connect(folder / FILE)) as connection:
        return connection.execute(f"SELECT {columns} FROM {table} ORDER BY number").fetchall()
