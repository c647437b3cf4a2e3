"""Fixtures that several floors' tests share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.store_keeping import PATIENCE_S, Keeping

# The same examples at each run; `make torture` tries others ("random"), and by seeds more of the long ones
# ("histories of commands", the fuzz rows).
settings.register_profile("recorded", derandomize=True, database=None, deadline=None)
settings.register_profile("random", derandomize=False, database=None, deadline=None, print_blob=True)
settings.load_profile("recorded")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long ones, so that no process works at one alone at the end."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


@pytest.fixture
def keeping(tmp_path: Path) -> Iterator[Callable[..., Keeping]]:
    """Give a function that opens a store; every store is closed with the test."""
    open_: list[Keeping] = []

    def make(path: Path | None = None, **options: int) -> Keeping:
        open_.append(Keeping(path or tmp_path / "state" / "x.sqlite", **options))
        return open_[-1]

    yield make
    for one in open_:
        one.store.close(within_s=PATIENCE_S)
