"""What several files of tests of the ledger need."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator
from pathlib import Path

import pytest


@pytest.fixture
async def path(tmp_path: Path) -> AsyncIterator[Path]:
    yield tmp_path / "x.sqlite"
    for thread in threading.enumerate():
        assert thread.name != "store", "a store was left open"
