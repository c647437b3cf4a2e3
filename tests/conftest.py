"""Fixtures that several layers' tests share."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.mosquitto import MosquittoBroker, missing_programs
from tests.store_keeping import PATIENCE_S, Keeping

# The same examples at each run; `make torture` has more, by a seed ("histories of commands", the fuzz rows).
settings.register_profile("recorded", derandomize=True, database=None, deadline=None)
settings.load_profile("recorded")

StartMosquitto = Callable[..., MosquittoBroker]


@pytest.fixture
def start_mosquitto(tmp_path: Path) -> Iterator[StartMosquitto]:
    """Give a function that starts a MosquittoBroker (same arguments); every broker ends with the test."""
    missing = missing_programs()
    if missing:
        text = f"not installed: {', '.join(missing)} (apt-get install mosquitto mosquitto-clients)"
        if os.environ.get("CI") == "true":
            pytest.fail(text)
        pytest.skip(text)
    brokers: list[MosquittoBroker] = []

    def start(**options: object) -> MosquittoBroker:
        broker = MosquittoBroker(tmp_path / f"mosquitto-{len(brokers)}", **options)  # type: ignore[arg-type]
        brokers.append(broker)
        broker.start()
        return broker

    yield start
    for broker in brokers:
        broker.kill()


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
