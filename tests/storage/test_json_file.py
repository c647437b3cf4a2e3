"""The small document that outlives the process."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from gateway.errors import DamagedError, StoreError
from gateway.storage.json_file import MOST_BYTES, RETRY_S, JsonFile, Saver
from tests.starters.plant import FakeMemory
from tests.starters.rig import virtually


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff", b"[" * 100_000, b" " * (MOST_BYTES + 1)])
def test_a_damaged_file_is_set_aside_and_stays_damaged_until_it_is_replaced(
    content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(content)
    memory = JsonFile(path)

    for _ in range(2):
        with pytest.raises(DamagedError):
            memory.load()
        memory.set_aside()

    assert (tmp_path / "x.json.damaged").read_bytes() == content
    asyncio.run(memory.save({"a": 1}))
    assert json.loads(path.read_bytes()) == {"a": 1, "version": 1}
    assert (tmp_path / "x.json.damaged").read_bytes() == content


def test_a_folder_in_the_files_place_is_set_aside_as_a_damaged_file_is(tmp_path: Path) -> None:
    for folder in (tmp_path / "x.json", tmp_path / "x.json.damaged"):
        folder.mkdir()
        (folder / "inside").touch()
    memory = JsonFile(tmp_path / "x.json")

    for _ in range(2):  # a crash before the next document comes does not hide the damage
        with pytest.raises(DamagedError):
            memory.load()
        memory.set_aside()
    asyncio.run(memory.save({"a": 1}))

    assert memory.load() == {"a": 1}
    assert (tmp_path / "x.json.damaged" / "inside").exists()
    assert (tmp_path / "x.json.damaged-2" / "inside").exists()


async def test_what_cannot_be_written_says_so_and_leaves_the_old(tmp_path: Path) -> None:
    (tmp_path / "x.json.new").mkdir()
    (tmp_path / "x.json").write_text("{}")

    with pytest.raises(StoreError):
        await JsonFile(tmp_path / "x.json").save({"a": 1})

    assert JsonFile(tmp_path / "x.json").load() == {}


class Desk:
    """A saver of a document that counts its changes."""

    def __init__(self, save_s: float = 0.0, *, delay_s: float = 0.0) -> None:
        self.memory = FakeMemory()
        self.memory.save_s = save_s
        self.number = 0
        self.troubles: list[str] = []
        self.saver = Saver(self.memory, self.document, on_trouble=self.troubles.append, delay_s=delay_s)

    def document(self) -> Mapping[str, Any]:
        return {"number": self.number}

    def change(self) -> None:
        self.number += 1
        self.saver.touch()


@virtually
async def test_a_change_is_saved_and_many_changes_at_once_few_times() -> None:
    reporting = Desk(save_s=0.1)
    for _ in range(10):
        reporting.change()
        await asyncio.sleep(0.01)

    assert await reporting.saver.saved(within_s=1.0)

    assert reporting.memory.document == {"number": 10}
    assert reporting.memory.saves == 2


@virtually
async def test_changes_that_may_wait_are_saved_together_and_at_once_when_somebody_waits_for_it() -> None:
    reporting = Desk(delay_s=1.0)
    for _ in range(40):
        reporting.change()
        await asyncio.sleep(0.3)

    assert reporting.memory.saves == 10

    reporting.change()
    assert await reporting.saver.saved(within_s=0.1)
    assert reporting.memory.document == {"number": 41}

    reporting.change()
    await asyncio.sleep(0.9)
    assert reporting.memory.document == {"number": 41}
    await asyncio.sleep(0.2)
    assert reporting.memory.document == {"number": 42}


@virtually
async def test_a_disk_that_takes_too_long_is_not_waited_for() -> None:
    reporting = Desk(save_s=60.0)
    reporting.change()

    assert not await reporting.saver.saved(within_s=1.0)
    assert asyncio.get_running_loop().time() == 1.0
    await asyncio.sleep(60.0)
    assert await reporting.saver.saved(within_s=1.0)


@virtually
async def test_what_could_not_be_saved_is_reported_once_and_tried_again() -> None:
    reporting = Desk()
    reporting.memory.is_away = True
    reporting.change()
    assert not await reporting.saver.saved(within_s=1.0)
    reporting.change()
    await asyncio.sleep(2.5 * RETRY_S)

    reporting.memory.is_away = False
    await asyncio.sleep(RETRY_S)

    assert reporting.memory.document == {"number": 2}
    assert reporting.troubles == ["no space left", ""]
