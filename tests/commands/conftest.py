"""What several files of tests of the commands need."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from tests.commands.parameters_place import RUNNERS
from tests.virtual_time import VirtualTimeLoop


@pytest.fixture
def one_loop() -> Iterator[None]:
    """Let all commands of a test run on one loop, since a starter's life has one clock."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        RUNNERS.append(runner)
        yield
        RUNNERS.clear()
