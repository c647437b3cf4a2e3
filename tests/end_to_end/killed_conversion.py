"""Converts a database and a document, killed at each point where something reaches the disk: a program.

Each round forks a process of its own, which kills itself (SIGKILL) at the next point. One line a round is
written: the point, and which versions the round has left.
"""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gateway.storage.database import Connection, Database, stored_version
from gateway.storage.formats.catalogue import FORMATS, FileKind, Format
from gateway.storage.json_file import JsonFile
from tests.storage.store_rig import Things, insert, texts

SQLITE, JSON = "history.db", "wear.json"
MOST_POINTS = 200


class Points:
    """Counts points, and ends the process at one of them."""

    def __init__(self, deadly: int) -> None:
        self._left = deadly

    def passed(self) -> None:
        if self._left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        self._left -= 1

    def before(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: Any, **options: Any) -> Any:
            self.passed()
            return call(*args, **options)

        return counted


def arm(deadly: int) -> None:
    """Let every statement of SQLite, and everything that reaches the disk otherwise, be a point."""
    points = Points(deadly)

    class Counting(sqlite3.Connection):
        def execute(self, *args: Any) -> sqlite3.Cursor:
            points.passed()
            return super().execute(*args)

        def backup(self, *args: Any, **options: Any) -> None:
            points.passed()
            super().backup(*args, **options)
            points.passed()

    connect = sqlite3.connect
    sqlite3.connect = lambda *args, **options: connect(*args, factory=Counting, **options)  # type: ignore[assignment]
    os.fsync = points.before(os.fsync)
    Path.replace = points.before(Path.replace)  # type: ignore[method-assign]
    Path.unlink = points.before(Path.unlink)  # type: ignore[method-assign]


def upper(connection: Connection) -> None:
    connection.execute("UPDATE thing SET text = upper(text)")


def convert(folder: Path) -> None:
    """Do what a start does."""
    database = Database(folder / SQLITE, [Things()], 2**20)
    if put_aside := database.open():
        raise AssertionError(put_aside)
    database.close()
    file = JsonFile(folder / JSON)
    file.write(file.load() or {})


def main(folder: Path) -> None:
    """Go on until a round ends by itself."""
    for point in range(MOST_POINTS):
        place = folder / str(point)
        place.mkdir()
        database = Database(place / SQLITE, [Things()], 2**20)
        database.open()
        database.transact([insert("a")])
        database.close()
        (place / JSON).write_text('{"counts": 1}')
        if (child := os.fork()) == 0:
            use_second_version()
            arm(point)
            convert(place)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        left = stored_version(place / SQLITE), JsonFile(place / JSON).version()
        line = json.dumps({"point": point, "is_killed": os.WIFSIGNALED(status), "left": left})
        os.write(1, f"{line}\n".encode())
        if not os.WIFSIGNALED(status):
            sys.exit(os.waitstatus_to_exitcode(status))


def use_second_version() -> None:
    FORMATS[SQLITE] = Format(SQLITE, FileKind.SQLITE, (upper,))
    FORMATS[JSON] = Format(JSON, FileKind.JSON, (lambda document: {"writes": document["counts"]},))


def rows_in(path: Path) -> list[str]:
    """Return the texts of a database as it is."""
    connection = sqlite3.connect(path)
    found = texts(connection)
    connection.close()
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]))
