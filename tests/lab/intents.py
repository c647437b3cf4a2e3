"""How long the intent of a start takes to be on the disk while the outbox is full and values pour in.

python -m tests.lab.intents [--seconds 30] [--rows 135000]

The broker is away. The outbox is filled first; then 2000 values a second replace each other, so each becomes
a row, and 20 intents a second are timed from their submission to their commit. Beside them plain writes of
4 kB with a flush are timed in the same folder, as a measure of the disk, and how late the loop comes to its
timers.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
import time
from math import inf
from pathlib import Path

from gateway.contract import Phase, Quality, ResultRecord, ValueRecord
from gateway.mqtt.message import message_of
from gateway.mqtt.outbox.disk_sync import DiskSync
from gateway.mqtt.outbox.outbox import Outbox
from gateway.store import Journal, OutboxTable, StateStore
from gateway.system.clock import SystemClock
from tests.lab.bench.account import quantile

VALUES_PER_S, INTENTS_PER_S = 2000, 20
TICK_S = 0.02
PARTS = (0.5, 0.9, 0.99, 1.0)
TOPICS = 700
FILL_PER_S = 6000  # values, at most, while the backlog is being made
SETTLE_S = 3.0


async def pour(outbox: Outbox, clock: SystemClock, per_s: float, until: float = inf) -> None:
    """Put values that replace each other, up to so many."""
    begun_s, count = time.monotonic(), 0
    while count < until:
        await asyncio.sleep(TICK_S)
        while count < min((time.monotonic() - begun_s) * per_s, until):
            count += 1
            record = ValueRecord(
                starter=f"starter-{count % TOPICS}", point="current", value=count / 7, unit="A",
                quality=Quality.GOOD, time_s=clock.utc_s(), seq=count, boot="0123456789ab",
            )  # fmt: skip
            outbox.put(message_of(record, "starters/bench"), clock.now_s())


def main() -> None:
    """Run it and print what was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.intents", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--rows", type=int, default=135_000, help="of the backlog")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(_measure(Path(folder), args.seconds, args.rows))


async def _measure(folder: Path, seconds: float, rows: int) -> None:
    clock = SystemClock()
    outbox = Outbox(last_topic="starters/bench/gateway/status", boot="0123456789ab")
    state = StateStore(
        folder / "state.sqlite",
        boot="0123456789ab",
        publish_event=lambda *_, **__: None,
    )
    sync = DiskSync(
        outbox,
        state.store,
        OutboxTable(),
        clock=clock,
        publish_event=lambda *_, **__: None,
        wake=lambda: None,
    )
    state.start("bench", on_recalled=lambda _: None)
    running = asyncio.create_task(sync.run())
    await pour(outbox, clock, FILL_PER_S, rows)
    await asyncio.sleep(SETTLE_S)
    waiting = outbox.backlog.waiting()
    flushes: list[float] = []
    others = (pour(outbox, clock, VALUES_PER_S), _flush(folder / "plain", flushes))
    tasks = [running, *map(asyncio.create_task, others)]
    found, late = await _intents(state.commands, seconds)
    for task in tasks:
        task.cancel()
    now = outbox.backlog.waiting()
    print(f"backlog {waiting[:2]} -> {now[:2]} rows, bytes; load {os.getloadavg()[0]:.1f}")
    for name, times in (("intent", found), ("loop late", late), ("plain flush", flushes)):
        parts = ", ".join(f"p{part * 100:g} {quantile(times, part) * 1e3:.1f}" for part in PARTS)
        print(f"{name:12} {len(times):4}  {parts} ms", flush=True)
    await state.close("the bench is over")


async def _flush(path: Path, found: list[float]) -> None:
    while True:
        await asyncio.sleep(0.25)
        found.append(await asyncio.to_thread(_flushed_s, path))


def _flushed_s(path: Path) -> float:
    begun_s = time.monotonic()
    with path.open("ab") as file:
        file.write(b"x" * 4096)
        file.flush()
        os.fdatasync(file.fileno())
    return time.monotonic() - begun_s


async def _intents(journal: Journal, seconds: float) -> tuple[list[float], list[float]]:
    """Time intents; beside them how late the loop itself comes to its timers."""
    found: list[float] = []
    late: list[float] = []
    begun_s = time.monotonic()
    for number in range(int(seconds * INTENTS_PER_S)):
        due_s = begun_s + number / INTENTS_PER_S
        await asyncio.sleep(max(due_s - time.monotonic(), 0.0))
        submitted_s = time.monotonic()
        late.append(submitted_s - due_s)
        result = ResultRecord(
            starter="pump", client="bench", id=str(number), verb="start", phase=Phase.ACCEPTED, code="ok",
            text="the start is about to be written", time_s=time.time(),
        )  # fmt: skip
        await journal.intend(result)
        found.append(time.monotonic() - submitted_s)
    return found, late


if __name__ == "__main__":
    main()
