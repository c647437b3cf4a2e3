"""A small JSON document that outlives the process: read once at the start, written whole at each change."""

from __future__ import annotations

import asyncio
import itertools
import json
import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from gateway.errors import DamagedError, StoreError
from gateway.storage.formats import FORMAT, KEY, require_known
from gateway.system.rate_limits import ChangeDetector
from gateway.system.whole_files import without_waiting, write_whole

logger = logging.getLogger(__name__)

MOST_BYTES = 16 * 2**20
RETRY_S = 5.0


class JsonStore(Protocol):
    """Where the document is stored."""

    def load(self) -> Mapping[str, Any] | None:
        """Return the document; None when there is none, DamagedError when it cannot be read any more."""

    def set_aside(self) -> None:
        """Store a damaged document apart from the next one."""

    async def save(self, document: Mapping[str, Any]) -> None:
        """Replace the stored document; StoreError."""


class NoStore:
    """Stores nothing."""

    def load(self) -> Mapping[str, Any] | None:
        """Return None: nothing was stored."""
        return None

    def set_aside(self) -> None:
        """Do nothing."""

    async def save(self, document: Mapping[str, Any]) -> None:
        """Do nothing."""


class JsonFile(JsonStore):
    """A JSON file, replaced in one step; a damaged one is set aside as `<name>.damaged`.

    The version of its format stands in the file only: documents given and returned are without it. While
    `is_on` is False nothing is saved.
    """

    def __init__(self, path: Path, *, is_on: bool = True) -> None:
        self.is_on = is_on
        self._path = path

    def version(self) -> int | None:
        """Return the version of the file as it is; None when there is none, or none that can be read."""
        try:
            content = self._content()
            return None if content is None else _version_in(self._path, _parsed(self._path, content))
        except DamagedError:
            return None

    def load(self) -> Mapping[str, Any] | None:
        """Return the document of the file; NewerError."""
        content = self._content()
        return None if content is None else self.understood(content)

    def understood(self, content: bytes) -> Mapping[str, Any]:
        """Return the document in a content, which need not be the file's."""
        document = _parsed(self._path, content)
        require_known(self._path, _version_in(self._path, document))
        document.pop(KEY, None)
        return document

    def _content(self) -> bytes | None:
        try:
            with open(self._path, "rb", opener=without_waiting) as file:
                return file.read(MOST_BYTES + 1)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise DamagedError(f"{self._path} cannot be read: {error.strerror}") from error

    def _encoded(self, document: Mapping[str, Any]) -> bytes:
        return json.dumps({**document, KEY: FORMAT}).encode()

    def set_aside(self) -> None:
        """Give the file a second name, so that it can be examined later.

        It stays in place until the next document replaces it, so that another start finds the damage too. A
        folder of that name is renamed and replaced by an empty file, which counts as damaged.
        """
        aside = self._path.with_name(f"{self._path.name}.damaged")
        try:
            if self._path.is_dir():
                self._path.rename(_free(aside))
                self._path.touch(mode=0o600)
                return
            if aside.is_dir():  # one that was set aside before
                aside = aside.with_name(f"{self._path.name}.damaged-file")
            aside.unlink(missing_ok=True)
            aside.hardlink_to(self._path)
        except OSError as error:
            logger.error("file=%s cannot be set aside: %s", self._path, error.strerror)  # noqa: TRY400 - one line

    async def save(self, document: Mapping[str, Any]) -> None:
        """Write the file, in a thread; done when it is on the disk."""
        if self.is_on:
            await asyncio.to_thread(self._write, self._encoded(document))

    def write(self, document: Mapping[str, Any]) -> None:
        """Write the file and wait for the disk."""
        self._write(self._encoded(document))

    def _write(self, content: bytes) -> None:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, content)
        except OSError as error:
            raise StoreError(f"{self._path} cannot be written: {error.strerror}") from error


class ReadOnlyStore(NoStore):
    """What another process stores: it is read, and nothing of it changed or set aside."""

    def __init__(self, memory: JsonStore) -> None:
        self._memory = memory

    def load(self) -> Mapping[str, Any] | None:
        """Return the stored document."""
        return self._memory.load()


class Saver:
    """Has the present document saved after each change: one save at a time, again after a failure."""

    def __init__(
        self,
        memory: JsonStore,
        document: Callable[[], Mapping[str, Any]],
        *,
        on_trouble: Callable[[str], None],
        delay_s: float = 0.0,
    ) -> None:
        self._memory = memory
        self._document = document
        self._delay_s = delay_s  # so long a change may wait for others, unless `saved` is called
        self._on_trouble = on_trouble  # called at each change: what is wrong, or an empty text
        self._said = ChangeDetector("")
        self._changes = 0  # so far
        self._saved_changes = 0  # of them
        self._saving: asyncio.Task[None] | None = None
        self._retry: asyncio.TimerHandle | None = None

    def touch(self) -> None:
        """Have the document saved soon, because it has changed."""
        self._changes += 1
        if not self._delay_s or self._saving is not None:
            self._begin()
        elif self._retry is None:
            self._retry = asyncio.get_running_loop().call_later(self._delay_s, self._begin)

    async def saved(self, *, within_s: float) -> bool:
        """Return whether everything up to now is on the disk, after waiting for that at most so long."""
        changes = self._changes
        if self._saved_changes < changes:
            self._begin()
        if self._saving is not None:
            await asyncio.wait((self._saving,), timeout=within_s)
        return self._saved_changes >= changes

    async def close(self, *, within_s: float) -> None:
        """Save what has changed, if that is possible in time, and then do nothing more."""
        await self.saved(within_s=within_s)
        if self._retry is not None:
            self._retry.cancel()

    def _begin(self) -> None:
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self._saving is None:
            self._saving = asyncio.get_running_loop().create_task(self._save())

    async def _save(self) -> None:
        trouble = ""
        try:
            while self._saved_changes < self._changes and not trouble:
                changes = self._changes
                try:
                    await self._memory.save(self._document())
                except StoreError as error:
                    trouble = str(error)
                    self._retry = asyncio.get_running_loop().call_later(RETRY_S, self._begin)
                else:
                    self._saved_changes = changes
        finally:
            self._saving = None
        if self._said.is_new(trouble):
            self._on_trouble(trouble)


def _free(path: Path) -> Path:
    """Return this path, or the first one with a number behind it that is not taken."""
    numbered = (path.with_name(f"{path.name}-{number}") for number in itertools.count(2))
    return next(each for each in itertools.chain((path,), numbered) if not os.path.lexists(each))


def _parsed(path: Path, content: bytes) -> dict[str, Any]:
    """Return the document in a file's content; DamagedError."""
    try:
        document = json.loads(content) if len(content) <= MOST_BYTES else None
    except (ValueError, RecursionError):
        document = None
    if isinstance(document, dict):
        return document
    raise DamagedError(f"{path} is damaged")


def _version_in(path: Path, document: Mapping[str, Any]) -> int:
    """Return the version of a document; one that says none has the first. DamagedError."""
    version = document.get(KEY, FORMAT)
    if type(version) is not int or version < FORMAT:
        raise DamagedError(f"{path} is damaged: its format is {version!r}")
    return version
