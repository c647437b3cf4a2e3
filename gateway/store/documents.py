"""Documents: small models that outlive the process, each read once at the start and saved whole.

What is saved is written behind, and the newest wins. A document that is not what its model says is as if it
was not there, and one event says so. A file that could not be read has damaged them all.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter, ValidationError

from gateway.contract import EventCode, PublishEvent
from gateway.errors import DamagedError, StoreError
from gateway.store.behind import Behind, is_done_within
from gateway.store.database import Connection, read_file, write_file
from gateway.store.import_0_2 import documents_of_0_2, import_files, is_import_due
from gateway.store.schema import STATE

T = TypeVar("T")

SAVED_WITHIN_S = 2.0

_READ = "SELECT name, body FROM documents"
_PUT = "REPLACE INTO documents VALUES (?, ?)"


class Documents:
    """All documents of a gateway, as an earlier run left them; without `behind` nothing is saved.

    While `is_operated` is False, documents that only commands need are not saved.
    """

    def __init__(
        self,
        behind: Behind | None = None,
        path: Path | None = None,
        *,
        is_operated: bool = True,
        publish_event: PublishEvent | None = None,
    ) -> None:
        self.is_operated = is_operated
        self.damage = ""  # why nothing is known from earlier; empty: it is
        self._behind = behind
        self._publish_event = publish_event
        self._bodies: dict[str, str] = {}
        self._documents: list[Document[Any]] = []
        try:
            self._bodies = read_bodies(path)
        except StoreError as error:
            self.damage = str(error)

    def open(
        self,
        name: str,
        kind: TypeAdapter[T],
        provide: Callable[[], T],
        *,
        delay_s: float = 0.0,
        is_for_operators: bool = False,
    ) -> Document[T]:
        """Return a document, as it was saved last; `provide` gives what is to be saved of it.

        So long as `delay_s` a change may wait for others.
        """

        def save() -> None:
            if self._behind is not None and (self.is_operated or not is_for_operators):
                body = self._bodies[name] = kind.dump_json(provide()).decode()
                self._behind.put(name, partial(put_body, name=name, body=body))

        document: Document[T] = Document(name, save, self._behind, delay_s=delay_s)
        self._documents.append(document)
        document.damage = self.damage
        try:
            document.loaded = parsed(kind, self._bodies.get(name), name)
        except DamagedError as error:
            document.damage = str(error)
            if self._publish_event is not None:
                self._publish_event(EventCode.MEMORY_DAMAGED, damage=error)
        return document

    def resume(self) -> None:
        """Have what the disk has missed saved, now that it is back."""
        if self._behind is not None:
            self._behind.resume()

    def save_all(self) -> None:
        """Save all documents again: the file was lost."""
        for document in self._documents:
            document.touch()

    async def close(self) -> None:
        """Save what has changed, if that is possible in time."""
        await asyncio.gather(*(document.saved() for document in self._documents))


class Document(Generic[T]):
    """One document. All calls on the app's loop."""

    def __init__(self, name: str, save: Callable[[], None], behind: Behind | None, *, delay_s: float) -> None:
        self.loaded: T | None = None  # by an earlier run
        self.damage = ""  # why it is not known what an earlier run saved
        self._name = name
        self._save = save
        self._behind = behind
        self._delay_s = delay_s
        self._timer: asyncio.TimerHandle | None = None  # while a change waits for others

    def touch(self) -> None:
        """Have the document saved soon, because it has changed."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(self._delay_s, self._write)

    async def saved(self, *, within_s: float = SAVED_WITHIN_S) -> bool:
        """Return whether everything up to now is on the disk, after waiting for that at most so long."""
        if self._timer is not None:
            self._write()
        if self._behind is None or self._name not in self._behind:
            return True
        return await is_done_within(self._behind.hurry(self._name), within_s)

    def _write(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        self._save()


def read_bodies(path: Path | None) -> dict[str, str]:
    """Return the documents in a file, by name; those of 0.2.0 while there is no file. StoreError."""
    if path is None or not path.parent.exists():
        return {}
    return documents_of_0_2(path.parent) if is_import_due(path.parent) else _read_bodies(path)


def _read_bodies(path: Path) -> dict[str, str]:
    try:
        return read_file(path, STATE, _bodies)
    except StoreError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            return {}
        raise


def read_document(path: Path, name: str, kind: TypeAdapter[T]) -> T | None:
    """Return a document of a gateway, also of one that runs; None when there is none. StoreError."""
    return parsed(kind, read_bodies(path).get(name), name)


def write_document(path: Path, name: str, kind: TypeAdapter[T], document: T) -> None:
    """Save a document for the next run of a gateway, which does not run now; StoreError."""
    import_files(path.parent)
    write_file(path, STATE, partial(put_body, name=name, body=kind.dump_json(document).decode()))


def put_body(connection: Connection, *, name: str, body: str) -> None:
    """Replace a document."""
    connection.execute(_PUT, (name, body))


def parsed(kind: TypeAdapter[T], body: str | None, name: str) -> T | None:
    """Return a document; DamagedError when it is not what its model says."""
    if body is None:
        return None
    try:
        return kind.validate_json(body)
    except ValidationError as error:
        raise DamagedError(f"what was stored of the {name} is damaged: {_first_mistake(error)}") from error


def _first_mistake(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_input=False)[0]
    return f"{'.'.join(map(str, first['loc']))} {first['msg']}".strip()


def _bodies(connection: Connection) -> dict[str, str]:
    return dict(connection.execute(_READ).fetchall())
