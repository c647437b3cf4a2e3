"""What is in the state of a gateway of the rig, read and changed behind its back."""

from __future__ import annotations

import json
import resource
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from gateway.store import STATE_FILE, write_document

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.rig.plant import RigPlant


_, HARD = resource.getrlimit(resource.RLIMIT_FSIZE)


def fail_disk(_: RigPlant | None = None) -> None:
    """Let every write to a file fail, as on a disk that is full or has errors, until the plant's end."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, HARD))


def heal_disk(_: RigPlant | None = None) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (HARD, HARD))


def stored_document(plant: RigPlant, name: str) -> Any:
    """Return a document as it is stored."""
    with closing(sqlite3.connect(plant.folder / "state" / STATE_FILE)) as connection:
        row = connection.execute("SELECT body FROM documents WHERE name = ?", (name,)).fetchone()
    return json.loads(row[0])


def with_document(name: str, body: str) -> Callable[[RigPlant], None]:
    """Let this be what an earlier run has stored as a document, whether it makes sense or not."""

    def write_it(plant: RigPlant) -> None:
        (plant.folder / "state").mkdir(exist_ok=True)
        write_document(plant.folder / "state" / STATE_FILE, name, TypeAdapter(int), 0)
        with_sql("UPDATE documents SET body = ? WHERE name = ?", body, name)(plant)

    return write_it


def with_sql(sql: str, *values: str) -> Callable[[RigPlant], None]:
    """Change the state by other means than the gateway's."""

    def change(plant: RigPlant) -> None:
        with closing(sqlite3.connect(plant.folder / "state" / STATE_FILE)) as connection, connection:
            connection.execute(sql, values)

    return change
