"""The gateway with a history that can be switched: `python -m tests.lab.bench.switched run CONFIG`.

The history is always on. Here it is off at first: readings and records go past it, and starters are not asked
for what it wants of them. SIGUSR1 switches it on, SIGUSR2 off. At the end the log says what it was given.
"""

from __future__ import annotations

import signal
import sys
from collections import Counter
from typing import Any

from gateway.app.history import HistoryService
from gateway.cli.main import main
from gateway.starters.services.past_reader import PastReader


class Switch:
    """Whether the history is on, and how often it was called."""

    def __init__(self) -> None:
        self.is_on = False
        self.calls: Counter[tuple[str, bool]] = Counter()

    def set(self, number: int, _frame: object) -> None:
        """Follow a signal."""
        self.is_on = number == signal.SIGUSR1

    def install(self) -> None:
        """Put the switch before everything that feeds the history."""
        take_readings, put, read = HistoryService.take_readings, HistoryService.put, PastReader._read

        def switched_readings(service: HistoryService, starter: str, readings: Any) -> None:
            self.calls["readings", self.is_on] += 1
            if self.is_on:
                take_readings(service, starter, readings)

        def switched_put(service: HistoryService, record: Any) -> None:
            self.calls["records", self.is_on] += 1
            if self.is_on:
                put(service, record)

        async def switched_read(reader: PastReader, codes: Any) -> Any:
            self.calls["reads", self.is_on] += 1
            return await read(reader, codes) if self.is_on else {}

        HistoryService.take_readings = switched_readings  # type: ignore[method-assign] # that is the point
        HistoryService.put = switched_put  # type: ignore[method-assign]
        PastReader._read = switched_read  # type: ignore[method-assign]
        signal.signal(signal.SIGUSR1, self.set)
        signal.signal(signal.SIGUSR2, self.set)

    def text(self) -> str:
        """Return what was called how often."""
        return ", ".join(
            f"{what} {'on' if is_on else 'off'}: {count}"
            for (what, is_on), count in sorted(self.calls.items())
        )


if __name__ == "__main__":
    switch = Switch()
    switch.install()
    code = main()
    print(f"switched {switch.text()}", file=sys.stderr, flush=True)
    sys.exit(code)
