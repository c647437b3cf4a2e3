"""Documents: small models that outlive the process, each read once at the start and saved whole.

A change is written behind, and the newest wins. A document that is not what its model says is as if it
was not there, and one event says so. A file that could not be read has damaged them all.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter, ValidationError

from gateway.contract import EventCode, PublishEvent
from gateway.errors import DamagedError, StoreError
from gateway.store.database import Connection, read_file, write_file
from gateway.store.import_0_2 import documents_of_0_2, import_files, is_import_due
from gateway.store.schema import STATE
from gateway.store.worker import BEHIND_S, Store

T = TypeVar("T")

SAVED_WITHIN_S = 2.0

_READ = "SELECT name, body FROM documents"
_PUT = "REPLACE INTO documents VALUES (?, ?)"


class Documents:
    """All documents of a gateway, as an earlier run left them; without a store nothing is saved."""

    def __init__(
        self,
        store: Store | None = None,
        path: Path | None = None,
        *,
        publish_event: PublishEvent | None = None,
    ) -> None:
        self.damage = ""  # why nothing is known from earlier; empty: it is
        self._store = store
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
    ) -> Document[T]:
        """Return a document, as it was saved last; `provide` gives what is to be saved of it.

        So long as `delay_s` a change may wait for others.
        """

        def save(within_s: float) -> Future[None] | None:
            if self._store is None:
                return None
            body = self._bodies[name] = kind.dump_json(provide()).decode()
            work = partial(put_body, name=name, body=body)
            return self._store.submit(work, key=("documents", name), is_urgent=True, within_s=within_s)

        document: Document[T] = Document(save, self._store, delay_s=delay_s)
        self._documents.append(document)
        document.damage = self.damage
        try:
            document.loaded = parsed(kind, self._bodies.get(name), name)
        except DamagedError as error:
            document.damage = str(error)
            if self._publish_event is not None:
                self._publish_event(EventCode.MEMORY_DAMAGED, damage=error)
        return document

    def save_all(self) -> None:
        """Save all documents again: the file was lost."""
        for document in self._documents:
            document.touch()

    async def close(self) -> None:
        """Save what has changed, if that is possible in time."""
        await asyncio.gather(*(document.saved() for document in self._documents))


class Document(Generic[T]):
    """One document. All calls on the app's loop."""

    def __init__(
        self, save: Callable[[float], Future[None] | None], store: Store | None, *, delay_s: float
    ) -> None:
        self.loaded: T | None = None  # by an earlier run
        self.damage = ""  # why it is not known what an earlier run saved
        self._save = save  # within so long
        self._store = store
        self._saving: Future[None] | None = None
        self._delay_s = delay_s
        self._timer: asyncio.TimerHandle | None = None  # while a change waits for others

    def touch(self) -> None:
        """Have the document saved soon, because it has changed."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(self._delay_s, self._write)

    async def saved(self, *, within_s: float = SAVED_WITHIN_S) -> bool:
        """Return whether everything up to now is on the disk, after waiting for that at most so long."""
        if self._timer is not None or (self._saving is not None and not self._saving.done()):
            self._write(0.0)
        if self._store is None or self._saving is None:
            return True
        return await self._store.has_done(self._saving, within_s)

    def _write(self, within_s: float = BEHIND_S) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        self._saving = self._save(within_s)


def read_bodies(path: Path | None) -> dict[str, str]:
    """Return the documents in a file, by name; those of 0.2.0 while there is no file. StoreError."""
    if path is None:
        return {}
    if is_import_due(path.parent):
        return documents_of_0_2(path.parent)
    return read_file(path, STATE, lambda file: dict(file.execute(_READ).fetchall())) if path.exists() else {}


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
        raise DamagedError(f"what was stored of the {name} is damaged: {error.errors()[0]['msg']}") from error
