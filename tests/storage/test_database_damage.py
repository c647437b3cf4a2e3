"""Damage that SQLite quotes in a message which is no text is damage too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gateway.storage.database import Database


class Notes:
    def create(self, connection: Any) -> None:
        connection.execute("CREATE TABLE IF NOT EXISTS notes (id INTEGER PRIMARY KEY, text TEXT)")

    def make_room(self, connection: Any) -> None:
        connection.execute("DELETE FROM notes")


def test_a_schema_that_is_no_utf_8_is_put_aside(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite"
    database = Database(path, [Notes()], 2**20)
    database.open()
    database.close()
    content = path.read_bytes()
    assert b"CREATE TABLE notes" in content
    path.write_bytes(content.replace(b"CREATE TABLE notes", b"CREATE TABLE \xfc\xfc\xfc ("))

    aside = database.open()

    assert "put aside" in aside
    assert database.is_open
    database.close()
