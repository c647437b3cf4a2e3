"""The audit log: a thread writes its entries to the disk, so that the caller never waits."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gateway.contract import AuditRecord, rfc3339
from gateway.storage.audit.writer import MOST_SEGMENTS, SEGMENT_BYTES, AuditWriter
from gateway.system.rate_limits import ChangeDetector

log = logging.getLogger(__name__)

MOST_WAITING = 5_000  # entries that wait for a disk that is away; what is more is lost, and counted
MOST_AT_ONCE = 200
RETRY_S = 5.0


class AuditLog:
    """Takes entries in order, and writes them in a thread of its own."""

    def __init__(
        self,
        folder: Path,
        *,
        boot: str,
        retry_s: float = RETRY_S,
    ) -> None:
        self._boot = boot
        self._on_trouble: Callable[[str], None] = lambda _: None
        self._writer = AuditWriter(folder, SEGMENT_BYTES, MOST_SEGMENTS)
        self._retry_s = retry_s
        self._queue: queue.SimpleQueue[Mapping[str, Any] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="audit", daemon=True)
        self._closing = threading.Event()
        self._lost = 0
        self._said = ChangeDetector("")

    def start(self, on_trouble: Callable[[str], None]) -> None:
        """Begin; the thread calls `on_trouble` with why nothing can be written, empty once it can."""
        self._on_trouble = on_trouble
        self._thread.start()

    def put(self, record: AuditRecord) -> None:
        """Take a decision about a command; returns at once."""
        said = record.fields()
        claims = {f"claimed_{claim}": said.pop(claim) for claim in ("operator", "reason")}
        self._take({"kind": "command", "boot": self._boot, **said, **claims})

    def note(self, code: str, text: str) -> None:
        """Take something that an auditor should know; returns at once."""
        self._take(self._note(code, text))

    def close(self, *, within_s: float) -> bool:
        """Write what waits and end; return whether there was time for it."""
        self._closing.set()
        self._queue.put(None)
        if self._thread.ident is not None:
            self._thread.join(within_s)
        return not self._thread.is_alive()

    def _take(self, entry: Mapping[str, Any]) -> None:
        if self._queue.qsize() >= MOST_WAITING:
            self._lost += 1  # reported once there is room
        else:
            self._queue.put(entry)

    def _note(self, code: str, text: str) -> dict[str, Any]:
        return {"kind": "note", "boot": self._boot, "time": rfc3339(time.time()), "code": code, "text": text}

    def _run(self) -> None:
        waiting: list[Mapping[str, Any]] = []
        is_over = False
        while not is_over:
            is_over = self._fetch(waiting)
            if self._lost:
                lost, self._lost = self._lost, 0
                waiting.append(self._note("entries_lost", f"{lost} entries could not be stored"))
            if self._write(waiting):
                waiting.clear()
            elif self._closing.wait(self._retry_s):
                is_over = True  # a disk that is still away is not waited for
        self._writer.close()

    def _fetch(self, waiting: list[Mapping[str, Any]]) -> bool:
        """Take what waits, at least one entry when there is none; return whether the end has come."""
        try:
            while len(waiting) < MOST_AT_ONCE:
                entry = self._queue.get_nowait() if waiting else self._queue.get()
                if entry is None:
                    return True
                waiting.append(entry)
        except queue.Empty:
            pass
        return False

    def _write(self, entries: list[Mapping[str, Any]]) -> bool:
        trouble = ""
        try:
            self._writer.append(entries, note=self._note)
        except OSError as error:
            self._writer.close()
            trouble = f"{error.filename or self._writer.folder}: {error.strerror or error}"
        except Exception:  # the guard at the thread's top: what cannot be written is not retried without end
            log.exception("audit=%s entries=%d cannot be written", self._writer.folder, len(entries))
            self._lost += len(entries)
        if self._said.is_new(trouble):
            self._on_trouble(trouble)
        return not trouble
