"""Commands on the disk: what became of each, by client and id; stops without an id until they end.

1. `intend` returns when it is on the disk that a command is about to be written; nothing else waits.
2. A result, its command's row and what is to be published of it are stored in one transaction.
3. What the disk has missed waits in memory, a bounded number of commands, and is written once it can be.
4. Until the table has been read it counts as away; also for a while after it was lost, because commands of
   before cannot be distinguished from new ones.

`starters.command.ledger` decides what is deleted, and when; there is no limit of age or number here.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import NamedTuple, Protocol

from gateway.contract import STOP, CommandError, Phase, ResultCode, ResultRecord
from gateway.errors import DamagedError, StoreError, UnstorableError
from gateway.store.database import Connection, Work
from gateway.store.worker import Store
from gateway.system.clock import Clock
from gateway.system.supervised import on_this_loop

INTEND_WITHIN_S = 1.0  # a start must not go out late because of a slow disk
PUBLISH_WITHIN_S = 2.0  # after this time a result is published without the disk
MOST_UNSAVED = 10_000
AT_ONCE = 100  # commands that are written again, or deleted, at a time
MOST_VALUES = 4096  # characters; a result with more is remembered without its values

# Begins the id under which a stop without one is stored: UNNAMED, the run, "/", the starter. It cannot be
# printed, so no client's id begins so.
UNNAMED = "\t"

Key = tuple[str, str]  # client and id
_Row = tuple[str, str, str, bool, str]  # the table's columns

_PUT = """
    INSERT INTO commands VALUES (?, ?, ?, ?, ?)
    ON CONFLICT (client, id) DO UPDATE SET starter = excluded.starter, result = excluded.result,
    may_be_written = max(may_be_written, excluded.may_be_written)
"""
_FORGET = "DELETE FROM commands WHERE client = ? AND id = ?"
_FORGET_UNNAMED = "DELETE FROM commands WHERE client = ? AND starter = ? AND substr(id, 1, 1) = ?"
_ROWS = "SELECT client, id, may_be_written, result FROM commands ORDER BY rowid"
_STORED = ("starter", "verb", "phase", "code", "text", "time_s")  # of a result, besides its values


class Remembered(NamedTuple):
    """What is known of a command of an earlier run."""

    result: ResultRecord  # its latest; not final when the run ended before the command did
    may_be_written: bool  # something may have reached the starter


class Journal(Protocol):
    """Where commands are stored. All calls on the app's loop."""

    @property
    def trouble(self) -> str:
        """Why nothing can be stored now; empty when it can."""

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        """Store a command's latest phase; `then` is called once, when it is stored or that takes too long."""

    async def intend(self, result: ResultRecord) -> None:
        """Return when it is on the disk that the command is about to be written; CommandError if not."""

    def forget(self, keys: Sequence[Key]) -> None:
        """Delete these commands."""


class NoJournal(Journal):
    """Stores nothing: the next run knows none of this run's commands."""

    trouble = ""

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:  # noqa: ARG002 - Journal's shape
        """Store nothing."""
        if then is not None:
            then()

    async def intend(self, result: ResultRecord) -> None:
        """Return at once."""

    def forget(self, keys: Sequence[Key]) -> None:
        """Do nothing."""


class CommandTable(Journal):
    """Stores commands on the disk; only `intend` and `settle` wait for it."""

    def __init__(
        self, store: Store, *, clock: Clock, hold_s: float, on_slow: Callable[[float], None]
    ) -> None:
        self.on_recalled: Callable[[Sequence[Remembered]], None] = lambda _: None
        self.row_of: Callable[[ResultRecord], Work | None] = lambda _: None  # what is stored with a final
        self._store = store
        self._clock = clock
        self._hold_s = hold_s
        self._on_slow = on_slow  # called when the disk delays a command
        self._is_recalled = False
        self._held_until_s = 0.0  # steady clock
        self._run = secrets.token_hex(4)  # names this run's stops without an id
        self._unsaved: OrderedDict[Key, Work] = OrderedDict()  # what the disk has missed
        self._forgotten: dict[Key, None] = {}  # to be deleted from the table

    @property
    def trouble(self) -> str:
        """Return why nothing can be stored now; empty when it can."""
        if self._store.trouble:
            return self._store.trouble
        if not self._is_recalled:
            return "it has not been read yet"
        wait_s = self._held_until_s - self._clock.now_s()
        if wait_s > 0:
            return (
                f"it was lost: for another {wait_s:.0f} s old commands cannot be distinguished from new ones"
            )
        return ""

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        """Store a command's latest phase; `then` is called once, when it is stored or that takes too long."""
        waiting = _Waiting(then)
        key = self._key(result)
        if key is None or (not result.id and result.phase.is_final):
            if key is not None:  # a stop without an id has ended: it cannot be repeated
                self.forget([key])
                self._forget_now()
            waiting.end()
            return
        row = _row(key, result, may_be_written=result.phase is Phase.WRITTEN or result.verb == STOP)
        also = self.row_of(result) if result.phase.is_final else None
        self._put(key, partial(_put, row=row, also=also), waiting)

    async def intend(self, result: ResultRecord) -> None:
        """Return when it is on the disk that the command is about to be written; CommandError if not."""
        key = self._key(result)
        if key is None:
            return
        try:
            async with asyncio.timeout(INTEND_WITHIN_S):
                work = partial(_put, row=_row(key, result, may_be_written=True))
                await asyncio.wrap_future(self._store.submit(work, is_urgent=True))
        except TimeoutError:
            slow = CommandError(ResultCode.LEDGER_UNAVAILABLE, "slow", within_s=INTEND_WITHIN_S)
            self._on_slow(INTEND_WITHIN_S)
            raise slow from None
        except StoreError as error:
            raise CommandError(ResultCode.LEDGER_UNAVAILABLE, "failed", error=error) from error

    def forget(self, keys: Sequence[Key]) -> None:
        """Delete these commands, many at a time; those that a crash leaves are deleted by the next run."""
        for key in keys:
            self._unsaved.pop(key, None)
            self._forgotten[key] = None
        if len(self._forgotten) >= AT_ONCE:
            self._forget_now()

    async def settle(self, within_s: float) -> None:
        """Return when all that was noted so far is on the disk, or cannot be."""
        with suppress(StoreError, TimeoutError):
            async with asyncio.timeout(within_s):
                await asyncio.wrap_future(self._store.submit(_nothing, is_urgent=True))

    def resume(self) -> None:
        """Go on after the store was opened: read it, the first time; write what it has missed."""
        if not self._is_recalled:
            done = self._store.submit(self._read, is_urgent=True)
            done.add_done_callback(on_this_loop(self._recall))
        self._save_unsaved()
        if self._forgotten:
            self._forget_now()

    def _key(self, result: ResultRecord) -> Key | None:
        """Return where a result is stored; None for nowhere."""
        if not result.id and result.verb != STOP:
            return None
        return result.client, result.id or f"{UNNAMED}{self._run}/{result.starter}"

    def _put(self, key: Key, work: Work, waiting: _Waiting) -> None:
        self._unsaved.pop(key, None)
        if key in self._forgotten:
            self._forget_now()  # before it is stored again

        def noted(future: Future[None]) -> None:
            waiting.end()
            error = future.exception()
            if error is None:
                self._save_unsaved()
            elif not isinstance(error, UnstorableError):  # else it would fail each time
                self._unsaved[key] = work
                if len(self._unsaved) > MOST_UNSAVED:
                    self._unsaved.popitem(last=False)

        self._store.submit(work, is_urgent=True).add_done_callback(on_this_loop(noted))

    def _save_unsaved(self) -> None:
        """Write what the disk has missed, a part at a time: each success starts the next part.

        All at once would hold up the loop, and with it a stop.
        """
        for _ in range(min(len(self._unsaved), AT_ONCE)):
            key, work = self._unsaved.popitem(last=False)
            self._put(key, work, _Waiting(None))

    def _forget_now(self) -> None:
        keys, self._forgotten = tuple(self._forgotten), {}
        work = partial(_forget, keys=keys)
        future = self._store.submit(work, is_urgent=True, is_flushed=False, is_freeing=True)
        future.add_done_callback(on_this_loop(partial(self._forget_again, keys)))

    def _forget_again(self, keys: Sequence[Key], future: Future[None]) -> None:
        """Delete later what could not be deleted: a stop that has ended would look as if it was cut short."""
        if future.exception() is not None:
            self._forgotten |= dict.fromkeys(keys)

    def _read(self, connection: Connection) -> list[Remembered]:
        ours = f"{UNNAMED}{self._run}"  # a stop that came before this was read
        found = connection.execute(_ROWS)
        return [remembered(*row) for row in found if not str(row[1]).startswith(ours)]

    def _recall(self, future: Future[list[Remembered]]) -> None:
        if self._is_recalled or future.exception() is not None:
            return  # `resume` tries again, when the store is open
        self._is_recalled = True
        if self._store.lost_s is not None:
            ago_s = max(0.0, self._clock.utc_s() - self._store.lost_s)
            self._held_until_s = self._clock.now_s() + self._hold_s - ago_s
        self.on_recalled(future.result())


class _Waiting:
    """A call that waits for the disk, for a limited time."""

    def __init__(self, call: Callable[[], None] | None) -> None:
        self._call = call
        self._timer = asyncio.get_running_loop().call_later(PUBLISH_WITHIN_S, self.end) if call else None

    def end(self) -> None:
        """Wait no longer."""
        call, self._call = self._call, None
        if self._timer is not None:
            self._timer.cancel()
        if call is not None:
            call()


def _nothing(_connection: Connection) -> None:
    """Have a transaction of its own, after all others."""


def _put(connection: Connection, *, row: _Row, also: Work | None = None) -> None:
    connection.execute(_PUT, row)
    if also is not None:
        also(connection)


def _forget(connection: Connection, *, keys: Sequence[Key]) -> None:
    """Delete the rows of these clients and ids; of a stop without an id, also those of earlier runs."""
    for client, id_ in keys:
        if id_.startswith(UNNAMED):
            connection.execute(_FORGET_UNNAMED, (client, id_.partition("/")[2], UNNAMED))
        else:
            connection.execute(_FORGET, (client, id_))


def _row(key: Key, result: ResultRecord, *, may_be_written: bool) -> _Row:
    said = {name: getattr(result, name) for name in _STORED}
    values = json.dumps(result.values, default=str)
    said["values"] = json.loads(values) if len(values) <= MOST_VALUES else {}
    return (*key, result.starter, may_be_written, json.dumps(said))


def remembered(client: str, id_: str, may_be_written: int, body: str) -> Remembered:
    """Return a command as it was stored; DamagedError."""
    try:
        said = json.loads(body)
        said["phase"] = Phase(said["phase"])
        result = ResultRecord(client=client, id=None if id_.startswith(UNNAMED) else id_, **said)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DamagedError("what was stored of a command is not readable") from error
    return Remembered(result, may_be_written=bool(may_be_written))
