"""A store of texts, with its news, for tests."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from gateway.store.database import Connection, Schema
from gateway.store.worker import News, Store

T = TypeVar("T")
PATIENCE_S = 10.0
INSERT = "INSERT INTO thing (text) VALUES (?)"


def _create(connection: Connection) -> None:
    connection.execute("CREATE TABLE thing (number INTEGER PRIMARY KEY, text TEXT NOT NULL)")


THINGS = Schema("things", (_create,))  # a table of texts


def insert(text: str) -> Callable[[Connection], None]:
    def work(connection: Connection) -> None:
        connection.execute(INSERT, (text,))

    return work


def texts(connection: Connection) -> list[str]:
    return [text for (text,) in connection.execute("SELECT text FROM thing ORDER BY number")]


class Keeping:
    """A store with its news, until `close`."""

    def __init__(self, path: Path | None, **options: Any) -> None:
        self.news: list[tuple[News, str]] = []
        self._changed = threading.Condition()
        self.store = Store(path, THINGS, **options)
        self.store.start(self._on_news)

    def do(self, work: Callable[[Connection], T]) -> T:
        return self.store.submit(work).result(PATIENCE_S)

    def until(self, news: News) -> str:
        """Wait until this was reported, and return the text of the first time."""
        with self._changed:
            assert self._changed.wait_for(lambda: news in self.kinds(), PATIENCE_S), self.news
        return next(text for kind, text in self.news if kind is news)

    def kinds(self) -> list[News]:
        return [kind for kind, _ in self.news]

    def close(self) -> None:
        assert self.store.close(within_s=PATIENCE_S)

    def _on_news(self, news: News, text: str) -> None:
        with self._changed:
            self.news.append((news, text))
            self._changed.notify_all()


Make = Callable[..., Keeping]
