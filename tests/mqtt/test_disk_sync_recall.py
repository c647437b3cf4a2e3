"""The outbox while its disk is away, hangs, or loses everything; in virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from gateway.mqtt.outbox.backlog import WINDOWS
from gateway.storage.spool import Kind
from tests.mqtt.spooling import InlineStore, SpoolRun, event, value
from tests.virtual_time import run_virtually


@pytest.fixture(autouse=True)
def inline_store(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.outbox.Store", InlineStore)


def test_without_a_disk_memory_serves_and_the_disk_learns_everything_when_it_is_back(tmp_path: Path) -> None:
    async def main() -> None:
        place = tmp_path / "state"
        place.write_text("in the way")
        first = await SpoolRun(place, "1").begin()
        first.put(event(1), value(1), value(2))
        await asyncio.sleep(10.0)
        first.connect()
        await asyncio.sleep(1.0)
        assert first.texts() == ["p/value/a=2", "event=1", 'p/history={"boot":"1","items":[1]}']
        first.disconnect()
        first.put(event(2), value(3))
        place.unlink()
        first.store.retry()
        await asyncio.sleep(1.0)
        first.kill()
        assert first.codes() == ["outbox_unavailable", "outbox_available"]

        second = await SpoolRun(place, "2").begin()
        second.connect()
        await asyncio.sleep(1.0)
        assert second.texts() == ["event=2", 'p/history={"boot":"1","items":[3]}']
        second.kill()

    run_virtually(main())


def test_a_disk_that_fails_in_the_middle_loses_nothing(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1").begin()
        run.put(event(1), value(1))
        await asyncio.sleep(1.0)
        run.path.unlink()
        run.path.mkdir()
        run.put(event(2), value(2))
        await asyncio.sleep(5.0)
        assert run.codes() == ["outbox_lost"]  # the folder is put aside, and all is written again
        run.put(event(3))
        await asyncio.sleep(1.0)
        run.kill()

        again = await SpoolRun(tmp_path, "2").begin()
        again.connect()
        await asyncio.sleep(1.0)
        assert again.texts("event") == ["1", "2", "3"]
        assert again.items() == [1, 2]
        again.kill()

    run_virtually(main())


def test_what_was_only_in_a_file_that_is_lost_is_declared_and_the_rest_written_again(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1").begin()
        for number in range(5000):
            run.put(value(number))
        await asyncio.sleep(3.0)
        window = WINDOWS[Kind.VALUE]
        assert run.memory_rows() == window
        run.path.unlink()
        run.put(value(5000))
        await asyncio.sleep(2.0)
        assert len(on_disk_while_open(run)) == window + 1
        run.connect()
        await asyncio.sleep(10.0)

        assert run.lost() == {"value": 5000 - window}
        assert run.items() == list(range(window))
        assert run.outbox.is_idle
        run.kill()

    run_virtually(main())


def on_disk_while_open(run: SpoolRun) -> list[object]:
    assert run.store._file._connection is not None
    return run.store._file._connection.execute("SELECT number FROM spool").fetchall()


def test_nothing_waits_for_a_disk_that_hangs(tmp_path: Path) -> None:
    async def main() -> None:
        run = await SpoolRun(tmp_path, "1").begin()
        for number in range(5000):
            run.put(event(number))
        await asyncio.sleep(3.0)
        run.store.is_hanging = True
        run.connect()
        run.put(event(5000))
        await asyncio.sleep(10.0)
        window = WINDOWS[Kind.EVENT]
        assert run.texts("event") == [*map(str, range(window)), "5000"]
        run.put(event(5001), value(1))
        await asyncio.sleep(1.0)
        assert run.texts("event")[-1] == "5001"
        assert run.texts("p/value/a") == ["1"]
        await run.end()

        again = await SpoolRun(tmp_path, "2").begin()
        again.connect()
        await asyncio.sleep(30.0)
        assert again.texts("event") == [str(number) for number in range(5000)]
        again.kill()

    run_virtually(main())


def test_who_waits_for_the_disk_is_allowed_to_go_on_without_it(tmp_path: Path) -> None:
    async def main() -> None:
        run = SpoolRun(tmp_path, "1")
        run.store.is_hanging = True
        called: list[float] = []
        run.disk_sync.when_recalled(lambda: called.append(run.loop.time()))
        await run.begin()
        await asyncio.sleep(10.0)

        assert called == [5.0]
        run.kill()

    run_virtually(main())
