"""The outbox and its file over outages and crashes; in virtual time, with real files."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.mqtt.contract.payloads import MAX_HISTORY_ITEMS
from gateway.mqtt.outbox.disk_sync import BATCH_S
from tests.mqtt.spooling import InlineStore, SpoolRun, event, on_disk, result, value
from tests.virtual_time import run_virtually


@pytest.fixture(autouse=True)
def inline_store(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.outbox.Store", InlineStore)


def test_what_is_acknowledged_at_once_never_goes_to_the_disk(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1").begin()
        run.connect()
        written = run.store._file.transact
        transactions: list[object] = []
        run.store._file.transact = lambda *works, **how: transactions.append(works) or written(*works, **how)  # type: ignore[method-assign]  # counted

        for number in range(20):
            run.put(event(number), result(number), value(number))
            await asyncio.sleep(0.5)

        assert run.texts("event") == run.texts("result") == [str(number) for number in range(20)]
        assert transactions == []
        run.kill()

    run_virtually(main())


def test_the_newest_values_of_an_outage_outlive_a_kill_too_and_are_reported_once_without_one(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        first = await SpoolRun(tmp_path, "1").begin()
        first.put(value(1), value(2), value(3, point="b"))
        await asyncio.sleep(2 * BATCH_S)
        first.connect()
        await asyncio.sleep(2.0)
        assert first.texts() == ["p/value/a=2", "p/value/b=3", 'p/history={"boot":"1","items":[1]}']
        first.disconnect()
        first.put(value(4))
        await asyncio.sleep(2 * BATCH_S)
        first.kill()

        second = await SpoolRun(tmp_path, "2").begin()
        second.connect()
        await asyncio.sleep(2.0)

        assert second.texts() == ['p/history={"boot":"1","items":[4]}']
        second.kill()

    run_virtually(main())


def test_live_values_come_first_and_the_backlog_drains_at_its_pace(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1").begin()
        for number in range(10_000):
            run.put(value(number))
        await asyncio.sleep(2.0)
        began_s = run.loop.time()
        run.connect()
        for number in range(10_000, 10_100):
            run.put(value(number))
            await asyncio.sleep(0.1)
        await asyncio.sleep(5.0)

        live_s = [at_s - began_s for at_s, reported in run.reported if reported.retain]
        late = [(at_s - began_s, reported) for at_s, reported in run.reported if not reported.retain]
        assert live_s[0] == 0.0
        assert len(live_s) == 101
        assert max(second - first for first, second in pairwise(live_s)) < 0.2
        assert all(reported.topic == "b/p/history" for _, reported in late)
        assert all(reported.payload.count(b",") <= MAX_HISTORY_ITEMS for _, reported in late)
        assert run.items() == list(range(9_999))
        assert 9.0 < late[-1][0] < 12.0  # 1000 a second
        run.kill()

    run_virtually(main())


def test_a_long_backlog_of_events_comes_in_order_page_by_page(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1").begin()
        for number in range(6000):
            run.put(event(number), *([result(number)] if number % 3 == 0 else []))
        await asyncio.sleep(3.0)
        run.connect()
        for number in range(6000, 6050):
            run.put(event(number))
            await asyncio.sleep(0.1)
        await asyncio.sleep(30.0)

        assert run.texts("event") == [str(number) for number in range(6050)]
        assert run.texts("result") == [str(number) for number in range(0, 6000, 3)]
        assert run.lost() == {}
        run.kill()
        assert on_disk(tmp_path) == []

    run_virtually(main())


@pytest.mark.parametrize("is_reported_before", [True, False])
def test_a_final_result_that_the_ledger_wants_reported_again_is_reported_once(
    tmp_path: Path, is_reported_before: bool
) -> None:
    async def main() -> None:
        first = await SpoolRun(tmp_path, "1").begin()
        if not is_reported_before:
            first.put(result(7, key="alice/7"))
            await asyncio.sleep(1.0)
        first.kill()

        second = SpoolRun(tmp_path, "2")
        second.disk_sync.when_recalled(lambda: second.put(result(7, key="alice/7")))
        await second.begin()
        second.connect()
        await asyncio.sleep(2.0)

        assert second.texts("result") == ["7"]
        called: list[int] = []
        second.disk_sync.when_recalled(lambda: called.append(1))
        assert called == [1]
        second.kill()

    run_virtually(main())
