"""What only tests in real time may have: a broker."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.mosquitto import MosquittoBroker, StartMosquitto, missing_programs


@contextmanager
def _brokers(folder: Path) -> Iterator[StartMosquitto]:
    """Give a function that starts a MosquittoBroker (same arguments); every broker ends with the block."""
    missing = missing_programs()
    if missing:
        text = f"not installed: {', '.join(missing)} (apt-get install mosquitto mosquitto-clients)"
        if os.environ.get("CI") == "true":
            pytest.fail(text)
        pytest.skip(text)
    brokers: list[MosquittoBroker] = []

    def start(**options: object) -> MosquittoBroker:
        broker = MosquittoBroker(folder / f"mosquitto-{len(brokers)}", **options)  # type: ignore[arg-type]
        brokers.append(broker)
        broker.start()
        return broker

    yield start
    for broker in brokers:
        broker.kill()


@pytest.fixture
def start_mosquitto(tmp_path: Path) -> Iterator[StartMosquitto]:
    """Start brokers that end with the test."""
    with _brokers(tmp_path) as start:
        yield start


@pytest.fixture(scope="module")
def start_brokers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StartMosquitto]:
    """Start brokers that end with the module's last test."""
    with _brokers(tmp_path_factory.mktemp("brokers")) as start:
        yield start
