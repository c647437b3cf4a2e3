"""Appends to the audit's segments: chained, and of bounded size and number."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gateway.storage.audit.chain import Head, link
from gateway.storage.audit.segments import (
    LOCK,
    Anchor,
    read_anchor,
    segment_path,
    segments,
    tail,
    write_anchor,
)

SEGMENT_BYTES = 4 * 2**20
MOST_SEGMENTS = 16


class AuditWriter:
    """The end of the chain, of one thread. Close it after an OSError: the next call opens it again."""

    def __init__(self, folder: Path, segment_bytes: int, most_segments: int) -> None:
        self.folder = folder
        self._segment_bytes = segment_bytes
        self._most_segments = most_segments
        self._head = Head()
        self._number = 0
        self._size = 0
        self._fd: int | None = None
        self._lock: int | None = None

    def append(
        self, entries: list[Mapping[str, Any]], *, note: Callable[[str, str], Mapping[str, Any]]
    ) -> None:
        """Write entries and have them on the disk."""
        fd = self._fd
        if fd is None:
            said = self._open()
            entries = [*(note(code, text) for code, text in said), *entries]
            fd = self._begin_segment(self._number)
        elif not segment_path(self.folder, self._number).exists():
            fd = self._begin_segment(self._number + 1)  # it was removed: the chain will show that
        head, octets = self._head, bytearray()
        for entry in entries:
            line, head = link(head, entry)
            octets += line.encode() + b"\n"
        self._put(fd, bytes(octets))
        self._head = head
        if self._size >= self._segment_bytes:
            self._begin_segment(self._number + 1)
            self._forget_oldest()

    def close(self) -> None:
        """Close the files."""
        for fd in (self._fd, self._lock):
            if fd is not None:
                os.close(fd)
        self._fd = self._lock = None

    def _put(self, fd: int, octets: bytes) -> None:
        try:
            done = 0
            while done < len(octets):
                done += os.write(fd, octets[done:])
            os.fsync(fd)
        except OSError:
            os.ftruncate(fd, self._size)  # as if it had not been tried
            raise
        self._size += len(octets)

    def _open(self) -> list[tuple[str, str]]:
        """Find where the chain goes on; return what an auditor should know about that."""
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._lock_folder()
        said: list[tuple[str, str]] = []
        anchor = read_anchor(self.folder)
        numbers = segments(self.folder)
        head, is_sound = anchor.head, True
        for number in reversed(numbers):
            path = segment_path(self.folder, number)
            end = tail(path)
            if end.torn:
                os.truncate(path, end.size)
                said.append(("line_torn", f"{end.torn} octets of a line that was cut short were removed"))
            if not end.is_empty:
                head = end.head
                break
        if head is None or head.number < self._head.number:
            said.append(("chain_begun_anew", f"the chain's end, line {self._head.number} or later, is gone"))
            is_sound = False
        self._head = head or Head()
        newest = max([anchor.segment, *numbers])
        self._number = newest if is_sound and newest in numbers else newest + 1
        return said

    def _lock_folder(self) -> None:
        """Make sure that no other gateway writes here."""
        self._lock = os.open(self.folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OSError(error.errno, "is in use by another process", str(self.folder)) from error

    def _begin_segment(self, number: int) -> int:
        path = segment_path(self.folder, number)
        fd = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)
        if self._fd is not None:
            os.close(self._fd)
        self._fd, self._number = fd, number
        self._size = os.fstat(fd).st_size
        return fd

    def _forget_oldest(self) -> None:
        for number in segments(self.folder)[: -self._most_segments]:
            path = segment_path(self.folder, number)
            write_anchor(self.folder, Anchor(number, tail(path).head))
            path.unlink()
