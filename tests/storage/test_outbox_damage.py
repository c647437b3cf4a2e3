"""Whatever became of the outbox's file, the gateway starts, sends what is new, and reports no nonsense."""

from __future__ import annotations

import asyncio
import json
import random
from pathlib import Path

import pytest

from tests.lab.torture.of_disk import damage
from tests.mqtt.spooling import InlineStore, SpoolRun, event, result, value
from tests.virtual_time import run_virtually

WAYS = 60


@pytest.fixture(autouse=True)
def inline_store(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.storage.outbox.Store", InlineStore)


async def leave_something_behind(folder: Path) -> None:
    run = await SpoolRun(folder, "old").begin()
    for number in range(300):
        run.put(event(number), result(number), value(number))
    await asyncio.sleep(1.0)
    assert run.store._file._connection is not None
    run.kill()


def damage_all(folder: Path, dice: random.Random) -> None:
    for path in sorted(folder.iterdir()):
        damage(path, dice)


@pytest.mark.parametrize("seed", range(WAYS))
def test_a_damaged_file_never_prevents_the_start_and_no_nonsense_is_reported(
    tmp_path: Path, seed: int
) -> None:
    dice = random.Random(seed)
    texts = {str(number) for number in range(300)}

    async def main() -> None:
        await leave_something_behind(tmp_path)
        damage_all(tmp_path, dice)

        run = await SpoolRun(tmp_path, "new").begin()
        run.put(event(1000), value(1001))
        run.connect()
        await asyncio.sleep(10.0)

        assert set(run.texts("event")) - {"1000"} <= texts
        assert "1000" in run.texts("event")
        assert set(run.texts("result")) <= texts
        assert set(run.items(boot="old")) <= set(range(300))
        assert all(json.loads(text)["boot"] == "old" for text in run.texts("p/history"))
        assert run.outbox.is_idle
        assert set(run.codes()) <= {"outbox_lost", "gap"}
        run.disconnect()
        run.put(event(2000))
        await asyncio.sleep(1.0)
        run.kill()

        again = await SpoolRun(tmp_path, "newer").begin()
        again.connect()
        await asyncio.sleep(2.0)
        assert again.texts("event") == ["2000"]
        again.kill()

    run_virtually(main())
