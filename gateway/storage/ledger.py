"""The command ledger in the store: only `intend` and `settle` wait for the disk."""

from __future__ import annotations

import asyncio
import json
import secrets
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial

from gateway.contract import STOP, CommandError, Phase, ResultCode, ResultRecord
from gateway.errors import DamagedError, StoreError, UnstorableError
from gateway.storage.database import Connection
from gateway.storage.journal import Journal, Remembered
from gateway.storage.ledger_table import UNNAMED, LedgerRow, LedgerTable
from gateway.storage.worker import Store
from gateway.system.clock import Clock
from gateway.system.supervised import on_this_loop

INTEND_WITHIN_S = 1.0  # a start must not go out late because of a slow disk
PUBLISH_WITHIN_S = 2.0  # after this time a result is published without the disk
MOST_UNSAVED = 10_000
SAVE_AT_ONCE = 20  # of what the disk has missed
FORGET_AT_ONCE = 100  # keys
MOST_EXTRA = 16_384  # characters; a result with more is remembered without its values

_Read = tuple[list[Remembered], frozenset[tuple[str, str]]]


class StoredJournal(Journal):
    """Stores commands in the database.

    `on_undelivered` is called once, with the final results of earlier runs that the broker may not have had.
    Until the ledger has been read it counts as away; also for `hold_s` after it was lost, because commands of
    before cannot be distinguished from new ones. `on_slow` is called when the disk delays a command.
    """

    def __init__(
        self,
        store: Store,
        table: LedgerTable,
        *,
        clock: Clock,
        hold_s: float,
        on_slow: Callable[[float], None],
    ) -> None:
        self._store = store
        self._table = table
        self._clock = clock
        self._hold_s = hold_s
        self.on_recalled: Callable[[Sequence[Remembered]], None] = lambda _: None
        self.on_undelivered: Callable[[Sequence[ResultRecord]], None] = lambda _: None
        self._on_slow = on_slow
        self._is_recalled = False
        self._undelivered: set[str] = set()  # keys of final results on their way to the broker
        self._unsaved_deliveries: OrderedDict[str, None] = OrderedDict()
        self._forgotten: dict[tuple[str, str], None] = {}  # to be deleted from the table
        self._run = secrets.token_hex(4)  # names this run's stops without an id
        self._held_until_s = 0.0  # steady clock
        self._unsaved: OrderedDict[tuple[str, str], LedgerRow] = OrderedDict()  # what is not on the disk yet
        self._noted_last: Future[None] = Future()  # done once the latest phase is stored, or cannot be
        self._noted_last.set_result(None)

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
        """Store a command's latest phase; `then` is called when it is stored, or when that takes too long."""
        row = self._row(result, may_be_written=result.phase is Phase.WRITTEN or result.verb == STOP)
        if row is None or (not result.id and row.is_final):
            if row is not None:  # a stop without an id has ended: it cannot be repeated
                self.forget([(row.client, row.id)])
                self._forget_now()
            if then is not None:
                then()
            return
        self._unsaved.pop((row.client, row.id), None)
        if result.key:
            self._undelivered.add(result.key)
        waiting = _Waiting(then)
        self._noted_last = self._put(row)
        self._noted_last.add_done_callback(on_this_loop(lambda done: self._noted(row, done, waiting)))

    def after(self, then: Callable[[], None]) -> None:
        """Call this when all that was noted so far is stored, or when that takes too long."""
        if self._noted_last.done():
            then()
            return
        waiting = _Waiting(then)
        self._noted_last.add_done_callback(on_this_loop(lambda _: waiting.end()))

    async def intend(self, result: ResultRecord) -> None:
        """Return when it is on the disk that the command is about to be written; CommandError if not."""
        row = self._row(result, may_be_written=True)
        if row is None:
            return
        try:
            async with asyncio.timeout(INTEND_WITHIN_S):
                await asyncio.wrap_future(self._put(row))
        except TimeoutError:
            slow = CommandError(ResultCode.LEDGER_UNAVAILABLE, "slow", within_s=INTEND_WITHIN_S)
            self._on_slow(INTEND_WITHIN_S)
            raise slow from None
        except StoreError as error:
            raise CommandError(ResultCode.LEDGER_UNAVAILABLE, "failed", error=error) from error

    def forget(self, keys: Sequence[tuple[str, str]]) -> None:
        """Delete these commands, many at a time; those that a crash leaves are deleted by the next run."""
        for key in keys:
            self._unsaved.pop(key, None)
            self._forgotten[key] = None
        if len(self._forgotten) >= FORGET_AT_ONCE:
            self._forget_now()

    def delivered(self, key: str) -> None:
        """Note that the broker has a final result: it need not be published again after a crash."""
        if key in self._undelivered:
            self._undelivered.discard(key)
            self._save_delivered(key)

    async def settle(self, within_s: float) -> None:
        """Return when all that was noted so far is on the disk, or cannot be."""
        with suppress(StoreError, TimeoutError):
            async with asyncio.timeout(within_s):
                await asyncio.wrap_future(self._store.submit(_nothing))

    def resume(self) -> None:
        """Go on after the store was opened: read it, the first time; write what it has missed."""
        if not self._is_recalled:
            self._store.submit(self._read).add_done_callback(on_this_loop(self._recall))
        self._save_unsaved()
        if self._forgotten:
            self._forget_now()

    def _row(self, result: ResultRecord, *, may_be_written: bool) -> LedgerRow | None:
        if not result.id and result.verb != STOP:
            return None
        extra = json.dumps(result.values, default=str)
        return LedgerRow(
            client=result.client,
            id=result.id or f"{UNNAMED}{self._run}/{result.starter}",
            starter=result.starter,
            verb=result.verb,
            phase=result.phase.value,
            code=result.code,
            text=result.text,
            time_s=result.time_s,
            extra=extra if len(extra) <= MOST_EXTRA else "{}",
            is_final=int(result.phase.is_final),
            may_be_written=int(may_be_written),
            since_s=self._clock.utc_s(),
        )

    def _put(self, row: LedgerRow) -> Future[None]:
        if (row.client, row.id) in self._forgotten:
            self._forget_now()  # before it is stored again
        is_undelivered = bool(row.is_final) and f"{row.client}/{row.id}" in self._undelivered
        return self._store.submit(partial(self._table.put, row=row, is_undelivered=is_undelivered))

    def _forget_now(self) -> None:
        keys, self._forgotten = tuple(self._forgotten), {}
        future = self._store.submit(partial(self._table.forget, keys=keys), is_flushed=False)
        unnamed = [key for key in keys if key[1].startswith(UNNAMED)]
        if unnamed:  # or the next run would take an ended stop for one that was cut short
            future.add_done_callback(on_this_loop(lambda done: self._forget_again(unnamed, done)))

    def _forget_again(self, keys: Sequence[tuple[str, str]], future: Future[None]) -> None:
        if future.exception() is not None:
            self._forgotten |= dict.fromkeys(keys)

    def _noted(self, row: LedgerRow, future: Future[None], waiting: _Waiting) -> None:
        waiting.end()
        error = future.exception()
        if error is None:
            self._save_unsaved()
            return
        if isinstance(error, UnstorableError):
            return  # it would fail each time
        self._unsaved[row.client, row.id] = row
        if len(self._unsaved) > MOST_UNSAVED:
            self._unsaved.popitem(last=False)

    def _save_unsaved(self) -> None:
        """Write what the disk has missed, a part at a time: each success starts the next part.

        All at once would hold up the loop, and with it a stop.
        """
        for _ in range(min(len(self._unsaved), SAVE_AT_ONCE)):
            _, row = self._unsaved.popitem(last=False)
            noted = partial(self._noted, row, waiting=_Waiting(None))
            self._put(row).add_done_callback(on_this_loop(noted))
        for _ in range(min(len(self._unsaved_deliveries), SAVE_AT_ONCE)):
            key, _ = self._unsaved_deliveries.popitem(last=False)
            self._save_delivered(key)

    def _save_delivered(self, key: str) -> None:
        client, _, id_ = key.partition("/")
        work = partial(self._table.mark_delivered, client=client, id_=id_)
        future = self._store.submit(work, is_flushed=False)
        future.add_done_callback(on_this_loop(lambda done: self._on_delivered_saved(key, done)))

    def _on_delivered_saved(self, key: str, future: Future[None]) -> None:
        if future.exception() is None:
            self._save_unsaved()
        else:
            self._unsaved_deliveries[key] = None
            if len(self._unsaved_deliveries) > MOST_UNSAVED:
                self._unsaved_deliveries.popitem(last=False)

    def _read(self, connection: Connection) -> _Read:
        rows = self._table.rows(connection)
        ours = f"{UNNAMED}{self._run}"  # a stop that came before this was read
        earlier = [_remembered(row) for row in rows if not row.id.startswith(ours)]
        return earlier, self._table.undelivered(connection)

    def _recall(self, future: Future[_Read]) -> None:
        if self._is_recalled or future.exception() is not None:
            return  # `resume` tries again, when the store is open
        self._is_recalled = True
        if self._store.lost_s is not None:
            ago_s = max(0.0, self._clock.utc_s() - self._store.lost_s)
            self._held_until_s = self._clock.now_s() + self._hold_s - ago_s
        remembered, undelivered = future.result()
        self.on_recalled(remembered)
        results = (each.result for each in remembered if each.result.phase.is_final)
        finals = [result for result in results if (result.client, result.id) in undelivered]
        self._undelivered |= {result.key for result in finals}
        self.on_undelivered(finals)


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


def _remembered(row: LedgerRow) -> Remembered:
    try:
        values = json.loads(row.extra)
        phase = Phase(row.phase)
    except ValueError as error:
        raise DamagedError("a row of the ledger is not readable") from error
    result = ResultRecord(
        starter=row.starter,
        client=row.client,
        id=None if row.id.startswith(UNNAMED) else row.id,
        verb=row.verb,
        phase=phase,
        code=row.code,
        text=row.text,
        time_s=row.time_s,
        values=values if isinstance(values, dict) else {},
    )
    return Remembered(result, may_be_written=bool(row.may_be_written))
