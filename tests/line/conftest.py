"""What several files of tests of the line need."""

from __future__ import annotations

import os
import tty
from asyncio import AbstractEventLoop
from collections.abc import Callable, Iterator, Mapping

import pytest

from gateway.line.port.event_loop import new_precise_loop
from tests.line.opened import Pty


def pytest_asyncio_loop_factories() -> Mapping[str, Callable[[], AbstractEventLoop]]:
    """Have these tests run on the lines' own loop: ports open on no other."""
    return {"precise": new_precise_loop}


@pytest.fixture
def pty() -> Iterator[Pty]:
    master, slave = os.openpty()
    tty.setraw(slave)
    pair = Pty(master, os.ttyname(slave))
    os.close(slave)
    os.set_blocking(master, False)
    yield pair
    if pair.master >= 0:
        pair.hang_up()
