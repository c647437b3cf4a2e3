"""A store on a small disk of its own, which it has filled itself; only root can mount one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from subprocess import CalledProcessError

import pytest

from gateway.errors import StoreError
from gateway.store.database import Connection
from tests.lab.torture.of_disk import may_mount, small_disk
from tests.store.store_rig import Keeping, insert, texts

AT_ONCE = 200


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr("tests.lab.torture.of_disk.DISK_BYTES", 4 * 2**20)
    if not may_mount():
        pytest.skip("only root can mount a small disk")
    try:
        with small_disk(tmp_path / "disk"):
            yield tmp_path / "disk"
    except CalledProcessError:
        pytest.skip("no disk can be mounted here")


def delete_some(connection: Connection) -> int:
    some = "SELECT number FROM thing ORDER BY number LIMIT ?"
    return connection.execute(f"DELETE FROM thing WHERE number IN ({some})", (AT_ONCE,)).rowcount


def test_what_has_filled_the_disk_can_be_deleted_and_makes_room(disk: Path) -> None:
    one = Keeping(disk / "store", max_bytes=2**28)
    filled = 0
    with pytest.raises(StoreError, match="full"):  # noqa: PT012 - until it is
        while True:
            for last in [one.store.submit(insert(f"{filled + n} {'x' * 300}")) for n in range(500)]:
                last.result(10.0)
                filled += 1
    deleted = 0
    while some := one.store.submit(delete_some, is_freeing=True).result(10.0):
        deleted += some
    while one.store.trouble:
        pass
    one.do(insert("a"))

    assert deleted >= filled > 2000
    assert one.do(texts) == ["a"]
    one.close()
