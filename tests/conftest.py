"""Fixtures that several layers' tests share."""

from __future__ import annotations

import gc
import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling

from tests.store.store_rig import PATIENCE_S, Keeping

# The same examples at each run; `make torture` tries others ("random"), and by seeds more of the long ones
# ("histories of commands", the fuzz rows).
settings.register_profile("recorded", derandomize=True, database=None, deadline=None)
settings.register_profile("random", derandomize=False, database=None, deadline=None, print_blob=True)
settings.load_profile("recorded")

gc.set_threshold(20_000, 20, 20)  # a plant makes many objects, and few of them are garbage

# Where tests run in the background Ctrl-C is ignored, and every program that they start would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long ones, so that no process works at one alone at the end."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    if os.geteuid() != 0:
        for item in items:
            if item.get_closest_marker("root"):
                item.add_marker(pytest.mark.skip(reason="only root may do it"))


# What one process does, one after the other, with `--dist loadgroup`: the tests of the broker kit share two
# proofs; two demos that begin at once would take the same ports; a distribution's package is built once.
# (The mark that pytest-xdist 3.8 has for this does nothing with pytest 9.2.)
GROUPS = {
    "broker kit": re.compile(r"/deploy/test_broker_kit\.py::"),
    "demo": re.compile(r"/test_demo\.py::|::test_the_demo_"),
    "deb13": re.compile(r"^tests/packages/.*deb13"),
    "deb12": re.compile(r"^tests/packages/"),
}


class GroupScheduling(LoadScopeScheduling):
    """Each test by itself, but for the groups."""

    def _split_scope(self, nodeid: str) -> str:
        return next((name for name, tests in GROUPS.items() if tests.search(nodeid)), nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling | None:
    return GroupScheduling(config, log) if config.getvalue("dist") == "loadgroup" else None


@pytest.fixture(scope="module", autouse=True)
def _collected_tests_are_spared() -> None:
    """Let no full collection look through all collected tests again; what starts a thread ends that."""
    if not gc.get_freeze_count():
        gc.collect()
        gc.freeze()


@pytest.fixture
def keeping(tmp_path: Path) -> Iterator[Callable[..., Keeping]]:
    """Give a function that opens a store; every store is closed with the test."""
    open_: list[Keeping] = []

    def make(path: Path | None = None, **options: Any) -> Keeping:
        open_.append(Keeping(path or tmp_path / "state" / "x.sqlite", **options))
        return open_[-1]

    yield make
    for one in open_:
        one.store.close(within_s=PATIENCE_S)
