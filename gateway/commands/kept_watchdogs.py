"""The watchdogs that the gateway has kept, for those who set parameters while it does not run."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from gateway.errors import StoreError
from gateway.starters.known_watchdogs import WATCHDOGS_FILE, KnownWatchdogs
from gateway.starters.memory import FileMemory, Memory, NoMemory
from gateway.starters.setup import StarterSetup


class _ReadOnly(NoMemory):
    """Gives what a file holds; it is written once, at the end."""

    def __init__(self, memory: Memory) -> None:
        self.load = memory.load  # type: ignore[method-assign] # all else is nothing


def known_watchdogs(state_dir: Path, starters: Iterable[StarterSetup]) -> KnownWatchdogs:
    """Return what the gateway knew last of the starters of a line."""
    watchdogs = KnownWatchdogs(memory=_ReadOnly(FileMemory(state_dir / WATCHDOGS_FILE)))
    for setup in starters:
        watchdogs.add(setup)
    return watchdogs


def save_watchdogs(state_dir: Path, watchdogs: KnownWatchdogs) -> str:
    """Have the next run know these from its first poll on; return why that cannot be, empty when it was done.

    Where no gateway has ever run there is nothing to add to.
    """
    if not state_dir.is_dir():
        return ""
    try:
        FileMemory(state_dir / WATCHDOGS_FILE).write(watchdogs.to_document())
    except StoreError as error:
        return f"the next run does not know the watchdogs until it has read them: {error}"
    return ""
