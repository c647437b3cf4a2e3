"""The numbers of births and deaths, each on the disk before its CONNECT."""

from __future__ import annotations

import logging
from pathlib import Path

from gateway.contract import EventCode, Severity
from gateway.errors import DamagedError, StoreError
from gateway.plugins.interface import Gateway
from gateway.plugins.sparkplug.topics import SEQ_NUMBERS
from gateway.storage.json_file import JsonFile
from gateway.system.rate_limits import ChangeDetector

log = logging.getLogger(__name__)


class BirthNumbers:
    """`bdSeq` of one edge node; it goes on where the last run ended."""

    def __init__(self, file: Path, gateway: Gateway) -> None:
        self._store = JsonFile(file)
        self._gateway = gateway
        self._last: int | None = None  # None: not yet read
        self._said = ChangeDetector("")

    async def take(self) -> int:
        """Return the number of the next connection."""
        if self._last is None:
            self._last = await self._gateway.in_thread(self._read)
        number = self._last = (self._last + 1) % SEQ_NUMBERS
        trouble = ""
        try:
            await self._store.save({"bdSeq": number})
        except StoreError as error:
            trouble = str(error)
        if self._said.is_new(trouble) and trouble:
            self._gateway.publish_event(
                EventCode.MEMORY_AWAY, "sparkplug", severity=Severity.WARNING, trouble=trouble
            )
        return number

    def _read(self) -> int:
        try:
            document = self._store.load() or {}
        except DamagedError as error:
            log.warning("%s; births are counted from 0 again", error)
            self._store.set_aside()
            document = {}
        return int(document.get("bdSeq", SEQ_NUMBERS - 1))
