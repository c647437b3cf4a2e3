"""What the outbox gives up when there is too much, and how it says so; in virtual time, with real files."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from gateway.mqtt.outbox.backlog import WINDOWS
from gateway.mqtt.outbox.disk_sync import BATCH_S
from gateway.mqtt.outbox.segment import Segment
from tests.mqtt.spooling import InlineStore, SpoolRun, event, result, value
from tests.virtual_time import run_virtually


@pytest.fixture(autouse=True)
def inline_store(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.outbox.Store", InlineStore)


def test_a_day_without_a_broker_costs_no_memory_and_what_does_not_fit_is_declared(tmp_path: Path) -> None:
    most_rows, every_s, points = 10_000, 120, 48

    async def main() -> None:
        run = await SpoolRun(tmp_path, "1", most_rows=most_rows).begin()
        put = 0
        for second in range(0, 24 * 3600, every_s):
            run.put(*(value(put + number, point=f"p{number}") for number in range(points)))
            put += points
            if second % 600 == 0:
                run.put(event(second))
            await asyncio.sleep(every_s)
            assert run.memory_rows() <= sum(WINDOWS.values()) + 2 * points
        statistics = run.outbox.statistics(run.clock.now_s())
        assert statistics["depth"] <= most_rows + points
        assert statistics["bytes"] < 500 * most_rows
        run.connect()
        await asyncio.sleep(120.0)

        live = [int(text) for n in range(points) for text in run.texts(f"p/value/p{n}")]
        items = run.items()
        assert run.texts("event") == [str(second) for second in range(0, 24 * 3600, 600)]
        assert items == sorted(items)
        assert run.lost()["value"] == put - len(set(items) | set(live)) > 0
        assert items[0] == run.lost()["value"]  # the oldest have gone
        assert run.outbox.is_idle
        assert run.outbox.statistics(run.clock.now_s())["bytes"] == 0
        run.kill()

    run_virtually(main())


def test_a_full_disk_gives_up_values_then_events_then_results_and_says_so_even_after_a_kill(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        first = await SpoolRun(tmp_path, "1", most_rows=1000).begin()
        for number in range(0, 900, 3):
            first.put(result(number), event(number + 1), value(number + 2))
        await asyncio.sleep(2 * BATCH_S)
        for number in range(600):
            first.put(result(1000 + number))
        await asyncio.sleep(2 * BATCH_S)
        assert first.outbox.statistics(0.0)["depth"] <= 1000
        first.kill()

        second = await SpoolRun(tmp_path, "2").begin()
        second.connect()
        await asyncio.sleep(5.0)

        lost = second.lost()
        assert lost["value"] == 300
        assert lost["event"] == 300 - len(second.texts("event")) > 0
        assert len(second.texts("result")) == 900
        assert second.codes() == ["gap"]
        second.kill()

        third = await SpoolRun(tmp_path, "3").begin()
        third.connect()
        await asyncio.sleep(2.0)
        assert third.codes() == []  # it was reported
        third.kill()

    run_virtually(main())


def test_the_file_stays_below_its_bound_in_bytes_and_the_oldest_values_go(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1", max_bytes=128 * 1024).begin()
        for number in range(5000):
            run.put(value(number), *([event(number)] if number % 50 == 0 else []))
            if number % 100 == 0:
                await asyncio.sleep(1.0)
        await asyncio.sleep(1.0)
        assert run.path.stat().st_size <= 128 * 1024
        run.connect()
        await asyncio.sleep(20.0)

        items = run.items()
        assert run.lost() == {"value": 4999 - len(items)}
        assert items == list(range(4999 - len(items), 4999))
        assert len(run.texts("event")) == 100
        run.kill()

    run_virtually(main())


def test_a_lane_gives_the_rows_up_that_its_disk_does_not_have(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1").begin()
        for number in range(5000):
            run.put(value(number))
        await asyncio.sleep(3.0)
        assert run.store._file._connection is not None
        run.store._file._connection.execute("DELETE FROM spool WHERE number % 2")
        run.connect()
        await asyncio.sleep(60.0)

        assert run.lost()["value"] == 4999 - len(run.items())
        assert isinstance(run.outbox.backlog._segments[0], Segment)
        run.kill()

    run_virtually(main())
