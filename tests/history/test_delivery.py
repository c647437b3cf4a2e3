"""What a kill has left in the outbox, and the history lacks."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.contract import StartRecord
from gateway.plugins.history.delivery import Delivery
from gateway.store import HistoryRow
from tests.history.support import NO_OUTBOX


@pytest.mark.parametrize(
    ("left", "stored", "lacking"),
    [("ab", "", "ab"), ("ab", "6789", "ab"), ("a6", "6789", ""), ("678ab", "6789", "ab"), ("a8b", "78", "b")],
)
async def test_what_is_lacking_came_after_the_newest_that_is_there(
    left: str, stored: str, lacking: str
) -> None:
    asked: list[str] = []

    async def rows(*_: Any) -> list[HistoryRow]:
        return [HistoryRow("p", "start", id_, {}) for id_ in stored]

    async def payloads(keys: Any) -> dict[str, bytes]:
        asked.extend(keys)
        return {}

    parts: Any = SimpleNamespace(boot="new"), SimpleNamespace(rows=rows)
    delivery = Delivery(*parts, replace(NO_OUTBOX, payloads=payloads))
    delivery.note_left([f"p:start/{id_}" for id_ in left], ["p"])

    assert await delivery.take_left("p", StartRecord) == []
    assert asked == [f"p:start/{id_}" for id_ in lacking]
