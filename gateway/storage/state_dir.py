"""What a gateway stores in its state directory: the command ledger and the audit, in private files."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from gateway.contract import AuditRecord, EventCode, PublishEvent, Record, ResultRecord, Severity
from gateway.storage.audit.log import AuditLog
from gateway.storage.audit.segments import FOLDER
from gateway.storage.formats import OWN_NAMES
from gateway.storage.journal import Remembered
from gateway.storage.ledger import StoredJournal
from gateway.storage.ledger_table import LedgerTable
from gateway.storage.worker import RETRY_S, News, Store
from gateway.system.clock import Clock
from gateway.system.supervised import on_this_loop

log = logging.getLogger(__name__)

FILE = "gateway.sqlite"
CLOSE_WITHIN_S = 2.0
SETTLE_WITHIN_S = 2.0


class StateDir:
    """The store, the journal in it, and the audit; none of them ever prevents the gateway's start or stop.

    All calls on the app's loop. `hold_s` is how long an old command might still pass for a new one. Without
    operators it is no error, only a warning, when nothing can be stored.
    """

    takes = (AuditRecord,)

    def __init__(
        self,
        state_dir: Path,
        *,
        boot: str,
        clock: Clock,
        hold_s: float,
        is_read_only: bool,
        publish_event: PublishEvent,
        retry_s: float = RETRY_S,
    ) -> None:
        self._publish_event = publish_event
        self._severity = _severity(is_read_only=is_read_only)
        table = LedgerTable()
        self._store = Store(state_dir / FILE, [table], retry_s=retry_s)
        self._audit = AuditLog(state_dir / FOLDER, boot=boot, retry_s=retry_s)
        self._is_ledger_away = self._is_audit_away = False
        self.journal = StoredJournal(
            self._store,
            table,
            clock=clock,
            hold_s=hold_s,
            on_slow=lambda seconds: self._publish_event(
                EventCode.LEDGER_SLOW, severity=self._severity, seconds=seconds
            ),
        )

    def start(
        self,
        version: str,
        *,
        on_recalled: Callable[[Sequence[Remembered]], None],
        on_undelivered: Callable[[Sequence[ResultRecord]], None] = lambda _: None,
    ) -> None:
        """Begin; the files are opened in threads of their own.

        `on_recalled` gets the commands of earlier runs, `on_undelivered` those of their results that the
        broker may not have had.
        """
        self.journal.on_recalled, self.journal.on_undelivered = on_recalled, on_undelivered
        self._store.start(on_this_loop(self._on_store_news))
        self._audit.start(on_this_loop(self._on_audit_trouble))
        self._audit.note("gateway_started", f"version {version}")

    def put(self, record: Record) -> None:
        """Store what belongs into the audit."""
        if isinstance(record, AuditRecord):
            self._audit.put(record)

    def apply(self, *, is_read_only: bool) -> None:
        """Apply another configuration, and record in the audit from when."""
        self._severity = _severity(is_read_only=is_read_only)
        self._audit.note("gateway_reloaded", "by another configuration from now on")

    async def settle(self) -> None:
        """Write the last results, if the disk works, so that they can be published."""
        await self.journal.settle(SETTLE_WITHIN_S)

    async def close(self, reason: str) -> None:
        """Write what waits, as far as the disk lets us."""
        self._audit.note("gateway_ended", reason)
        closings = (self._store.close, self._audit.close)
        tasks = (asyncio.to_thread(close, within_s=CLOSE_WITHIN_S) for close in closings)
        if not all(await asyncio.gather(*tasks)):
            log.error("the disk took too long: the last commands may be missing in the ledger and the audit")

    def _on_store_news(self, news: News, text: str) -> None:
        match news:
            case News.OPEN:
                log.info("store %s", text)
                self.journal.resume()
                if self._is_ledger_away:
                    self._publish_event(EventCode.LEDGER_AVAILABLE)
                self._is_ledger_away = False
            case News.AWAY:
                self._publish_event(EventCode.LEDGER_UNAVAILABLE, severity=self._severity, trouble=text)
                self._is_ledger_away = True
            case News.LOST:
                self._publish_event(EventCode.LEDGER_LOST, severity=self._severity, trouble=text)

    def _on_audit_trouble(self, trouble: str) -> None:
        if trouble:
            self._publish_event(EventCode.AUDIT_UNAVAILABLE, severity=self._severity, trouble=trouble)
        elif self._is_audit_away:
            self._publish_event(EventCode.AUDIT_AVAILABLE)
        self._is_audit_away = bool(trouble)


def _severity(*, is_read_only: bool) -> Severity:
    """Return the severity of a failed store: an error where operators may give commands, else a warning."""
    return Severity.WARNING if is_read_only else Severity.ERROR


OTHERS = 0o077


def keep_private(folder: Path) -> None:
    """Give the gateway's own files in a folder mode 0600, also those that this process makes from now on.

    All others are left as they are: the folder may be one that other programs use too. So is what belongs to
    another user; folders keep their modes.
    """
    os.umask(OTHERS)
    own = [path for path in _files_in(folder) if OWN_NAMES.fullmatch(path.name)]
    for path in [*own, *_files_in(folder / FOLDER)]:
        with suppress(OSError):
            if path.lstat().st_mode & OTHERS and path.is_file() and not path.is_symlink():
                path.chmod(0o600)


def _files_in(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []
