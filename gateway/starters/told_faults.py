"""Which standing faults were published as events, so that the next run repeats none and leaves none out.

A fault counts as published once it has stood for `LASTING_S`: by then its event is in the outbox on the disk.
What is killed before that publishes it once more.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.errors import DamagedError
from gateway.starters.memory import Memory, NoMemory, Saver

FAULTS_FILE = "faults.json"  # in state_dir
LASTING_S = 5.0
KEPT_WITHIN_S = 1.0


class ToldFaults:
    """The standing faults of all starters; the file is read when this is made."""

    def __init__(self, *, memory: Memory | None = None) -> None:
        self._codes: dict[str, tuple[str, ...]] = {}
        self._saver = Saver(memory or NoMemory(), self.to_document, on_trouble=lambda _: None)
        self._restore(memory or NoMemory())

    def is_told(self, starter: str, codes: tuple[str, ...]) -> bool:
        """Return whether an earlier run has published the fault that these alarm codes name."""
        return bool(codes) and self._codes.get(starter) == codes

    def note(self, starter: str, codes: tuple[str, ...]) -> None:
        """Record the fault that stands and was published; none when there is no fault."""
        if self._codes.get(starter, ()) == codes:
            return
        if codes:
            self._codes[starter] = codes
        else:
            del self._codes[starter]
        self._saver.touch()

    def to_document(self) -> dict[str, Any]:
        """Return what must outlive the gateway."""
        return {"faults": {starter: list(codes) for starter, codes in self._codes.items()}}

    async def close(self) -> None:
        """Save what is left to be saved, and then do nothing more."""
        await self._saver.close(within_s=KEPT_WITHIN_S)

    def _restore(self, memory: Memory) -> None:
        try:
            faults = (memory.load() or {}).get("faults", {})
            if not isinstance(faults, Mapping):
                raise DamagedError("no faults in it")  # noqa: TRY301 - set aside as any other damage is
            self._codes = {str(name): tuple(str(code) for code in codes) for name, codes in faults.items()}
        except (DamagedError, TypeError):
            memory.set_aside()  # then a fault that stands is published once more
