"""A history file in memory, for virtual time: what the store's contract promises, without a disk."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gateway.errors import StoreError
from gateway.storage.history import COLLECT_S
from gateway.storage.history_table import HistoryRow


class MemoryFile:
    """Stands for `HistoryStore`; outlives the service that uses it, as a file does.

    `on_flush`, where it is set, is given all rows after each transaction: after an urgent row, or as long
    after another one as the store collects.
    """

    def __init__(self) -> None:
        self.rows: dict[tuple[str, str, str], HistoryRow] = {}
        self.is_away = False
        self.closed = 0
        self.on_flush: Callable[[Mapping[tuple[str, str, str], HistoryRow]], None] | None = None

    def start(self) -> None:
        pass

    def put(
        self,
        starter: str,
        kind: str,
        id_: str,
        *,
        time_s: float,
        data: Mapping[str, Any],
        limit: int,
        is_urgent: bool = False,
    ) -> None:
        stored = json.loads(json.dumps(data, allow_nan=False))
        self.rows[starter, kind, id_] = HistoryRow(starter, kind, id_, time_s, stored, limit)
        ours = [key for key in self.rows if key[:2] == (starter, kind)]
        for key in ours[:-limit]:
            del self.rows[key]
        if self.on_flush is not None and is_urgent:
            self.on_flush(self.rows)
        elif self.on_flush is not None:
            asyncio.get_running_loop().call_later(COLLECT_S, self.on_flush, self.rows)

    def drop(self, starter: str, kind: str, id_: str) -> None:
        self.rows.pop((starter, kind, id_), None)

    def when_stored(self, call: Callable[[], None]) -> None:
        call()

    async def load(
        self, starters: Sequence[str] | None = None, kinds: Sequence[str] = ()
    ) -> dict[str, list[HistoryRow]]:
        if self.is_away:
            raise StoreError("the disk is away")
        found: dict[str, list[HistoryRow]] = {}
        for row in self.rows.values():
            if (starters is None or row.starter in starters) and (not kinds or row.kind in kinds):
                found.setdefault(row.starter, []).append(row)
        return found

    async def row(self, starter: str, kind: str, id_: str) -> HistoryRow | None:
        if self.is_away:
            raise StoreError("the disk is away")
        return self.rows.get((starter, kind, id_))

    async def close(self, within_s: float) -> bool:
        self.closed += 1
        return True

    def of(self, starter: str, kind: str) -> list[Mapping[str, Any]]:
        return [row.data for row in self.rows.values() if (row.starter, row.kind) == (starter, kind)]
