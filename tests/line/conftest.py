"""What several files of tests of the line need."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator

import pytest

from tests.line.opened import Pty


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
