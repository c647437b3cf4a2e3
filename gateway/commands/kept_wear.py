"""Adds to the counts of writes to starters' memories that the gateway keeps; it does not run meanwhile."""

from __future__ import annotations

from pathlib import Path

from gateway.errors import DamagedError, StoreError
from gateway.starters.memory import FileMemory
from gateway.starters.wear import WEAR_FILE, totals_in


def count_writes(state_dir: Path, starter: str, writes: int) -> str:
    """Count so many more writes; return in words why that cannot be, empty when it was done.

    Where no gateway has ever run there is nothing to add to.
    """
    if not writes or not state_dir.is_dir():
        return ""
    memory = FileMemory(state_dir / WEAR_FILE)
    try:
        totals = totals_in(memory.load() or {"writes": {}})
        memory.write({"writes": {**totals, starter: totals.get(starter, 0) + writes}})
    except (DamagedError, StoreError) as error:
        return f"writes to the memory of {starter} that are not counted: {writes}; {error}"
    return ""
