"""Whether a starter is locked for maintenance: as the gateway, which does not run now, has kept it."""

from __future__ import annotations

from pathlib import Path

from gateway.clock import read_clocks
from gateway.errors import CommandError, DamagedError
from gateway.starters.logbook import PRECAUTIONS_FILE, Logbook
from gateway.starters.maintenance import refusal
from gateway.starters.memory import FileMemory


def lock_trouble(state_dir: Path, starter: str) -> CommandError | None:
    """Return why nothing may be set in this starter; None when it is not locked."""
    logbook = Logbook([starter])
    try:
        document = FileMemory(state_dir / PRECAUTIONS_FILE).load()
        if document is not None:
            logbook.restore(document, now_s=0.0, reading=read_clocks())
    except DamagedError as error:
        text = f"whether {starter} is locked cannot be read: {error}; run the gateway, look, then unlock"
        return CommandError("locked", text)
    lock = logbook.lock_of(starter)
    return None if lock is None else refusal(lock)
