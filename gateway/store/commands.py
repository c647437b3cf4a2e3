"""Commands on the disk: the outcome of each, by client and id; stops without an id until they end.

1. `intend` returns when it is on the disk that a command is about to be written; nothing else waits.
   No phase before the final one is published of what is not on the disk; a final one is after 2 s. A
   final one is noted once `accepted` is published, or cannot be: the outbox sends in the order of its rows.
2. A result, its command's row and what is to be published of it are stored in one transaction.
3. A result that was published without the disk, or that the disk has missed, waits in memory with a bounded
   number of others, and is written behind. The phase `written` is not: its row has said before that it may
   be.
4. Until the table has been read it counts as away. A copy of a command that was lost with it is not fresh:
   no proof outlives its connection.

`starters.command.ledger` decides what is deleted, and when; there is no limit of age or number here.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any, NamedTuple

from gateway.contract import (
    STOP,
    CommandError,
    EventCode,
    Phase,
    PublishEvent,
    ResultCode,
    ResultRecord,
)
from gateway.errors import DamagedError, StoreError
from gateway.store.database import Connection, Work
from gateway.store.worker import BEHIND_S, Store
from gateway.system.supervised import on_this_loop

INTEND_WITHIN_S = 1.0  # a start must not go out late because of a slow disk
PUBLISH_WITHIN_S = 2.0  # after this time a result is published without the disk

# Begins the id under which a stop without one is stored, before its starter's name. It cannot be printed, so
# no client's id begins so.
UNNAMED = "\t"

Key = tuple[str, str]  # client and id
_Row = tuple[str, str, str, bool, str]  # the table's columns

_PUT = """
    INSERT INTO commands VALUES (?, ?, ?, ?, ?)
    ON CONFLICT (client, id) DO UPDATE SET starter = excluded.starter, result = excluded.result,
    may_be_written = max(may_be_written, excluded.may_be_written)
"""
_FORGET = "DELETE FROM commands WHERE client = ? AND id = ?"
_ROWS = "SELECT client, id, may_be_written, result FROM commands ORDER BY rowid"
_STORED = ("starter", "verb", "phase", "code", "text", "time_s", "values")  # of a result


class Remembered(NamedTuple):
    """A command of an earlier run."""

    result: ResultRecord  # its latest; not final when the run ended before the command did
    may_be_written: bool  # something may have reached the starter


class Journal:
    """Stores commands; only `intend` and `settle` wait for the disk. All calls on the app's loop."""

    def __init__(self, store: Store, *, publish_event: PublishEvent) -> None:
        self.row_of: Callable[[ResultRecord], Work | None] = lambda _: None  # what is stored with a final
        self._store = store
        self._untold: dict[Key, Future[Any]] = {}  # phases before the final one that are being stored
        self._publish_event = publish_event
        self._is_recalled = False

    @property
    def trouble(self) -> str:
        """Return why nothing can be stored now; empty when it can."""
        return self._store.trouble or ("" if self._is_recalled else "it has not been read yet")

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        """Store a command's latest phase; `then` is called once that is stored.

        Of a final phase it is called as well when that fails, or takes too long.
        """
        key = _key(result)
        if key is None or result.phase is Phase.WRITTEN:
            if then is not None:
                then()
        elif then is None:
            self._put(key, result, is_urgent=result.phase.is_final)
        else:
            self._note_and_call(key, result, then)

    def _note_and_call(self, key: Key, result: ResultRecord, then: Callable[[], None]) -> None:
        """Store a phase and call once; of a final one also when the disk is away or too slow."""
        is_final, calls = result.phase.is_final, [then]

        def call() -> None:
            while calls:
                calls.pop()()

        def store(_: object = None) -> None:
            done = self._put(key, result, is_urgent=True, is_published=not calls)
            if not is_final:
                self._untold[key] = done
            done.add_done_callback(on_this_loop(end))

        def end(done: Future[Any]) -> None:
            if not is_final:
                self._untold.pop(key, None)
            if is_final or done.exception() is None:
                call()

        if key in self._untold:  # the outbox sends in the order of its rows: `accepted` gets the first
            self._untold[key].add_done_callback(on_this_loop(store))
        else:
            store()
        if is_final:
            within_s = 0.0 if self._store.is_away else PUBLISH_WITHIN_S
            asyncio.get_running_loop().call_later(within_s, call)

    def _put(
        self, key: Key, result: ResultRecord, *, is_urgent: bool, is_published: bool = False
    ) -> Future[Any]:
        """Store a phase; a final one with the outbox's row, which one that is published has already."""
        is_final = result.phase.is_final
        if is_final and not result.id:  # it cannot be repeated; a crash must not find it under way
            work: Work = partial(_forget, key=key)
        else:
            also = self.row_of(result) if is_final and not is_published else None
            work = partial(_put, row=_row(key, result), also=also)
        within_s = 0.0 if is_urgent else BEHIND_S
        return self._store.submit(work, key=("commands", *key), is_urgent=is_urgent, within_s=within_s)

    async def intend(self, result: ResultRecord) -> None:
        """Return when it is on the disk that the command is about to be written; CommandError if not."""
        key = _key(result)
        if key is None:
            return
        try:
            async with asyncio.timeout(INTEND_WITHIN_S):
                work = partial(_put, row=_row(key, result, is_intent=True))
                await asyncio.wrap_future(self._store.submit(work, is_urgent=True))
        except TimeoutError:
            self._publish_event(EventCode.STORE_SLOW, seconds=INTEND_WITHIN_S)
            raise CommandError(ResultCode.NOT_STORED, "slow", within_s=INTEND_WITHIN_S) from None
        except StoreError as error:
            raise CommandError(ResultCode.NOT_STORED, "failed", error=error) from error

    def forget(self, keys: Sequence[Key]) -> None:
        """Delete these commands; those that a crash leaves are deleted by the next run."""
        for key in keys:
            work = partial(_forget, key=key)
            self._store.submit(work, key=("commands", *key), within_s=BEHIND_S)

    async def settle(self, within_s: float) -> None:
        """Return when all that was noted so far is on the disk, or cannot be."""
        for _ in range(2):  # a final phase that has waited for `accepted` is noted after that
            await self._store.has_done(self._store.submit(lambda _: None), within_s)

    def recall(self, on_recalled: Callable[[Sequence[Remembered]], None]) -> None:
        """Have the commands of earlier runs read, once, before any of this run is written."""

        def take(done: Future[list[Remembered]]) -> None:
            if done.exception() is None:  # else a bug: without the ledger no start is taken
                self._is_recalled = True
                on_recalled(done.result())

        self._store.submit(_read, key=("recall",), is_urgent=True).add_done_callback(on_this_loop(take))


def _read(connection: Connection) -> list[Remembered]:
    return [remembered(*row) for row in connection.execute(_ROWS)]


def _put(connection: Connection, *, row: _Row, also: Work | None = None) -> None:
    connection.execute(_PUT, row)
    if also is not None:
        also(connection)


def _forget(connection: Connection, *, key: Key) -> None:
    connection.execute(_FORGET, key)


def _key(result: ResultRecord) -> Key | None:
    """Return under what a result is stored; None: it is not."""
    if not result.id and result.verb != STOP:
        return None
    return result.client, result.id or UNNAMED + result.starter


def _row(key: Key, result: ResultRecord, *, is_intent: bool = False) -> _Row:
    said = json.dumps({name: getattr(result, name) for name in _STORED}, default=str)
    return (*key, result.starter, is_intent or result.verb == STOP, said)


def remembered(client: str, id_: str, may_be_written: int, body: str) -> Remembered:
    """Return a command as it was stored; DamagedError."""
    try:
        said = json.loads(body)
        said["phase"] = Phase(said["phase"])
        result = ResultRecord(client=client, id=None if id_.startswith(UNNAMED) else id_, **said)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DamagedError("what was stored of a command is not readable") from error
    return Remembered(result, may_be_written=bool(may_be_written))
