"""How late an event loop is: what blocks it, or starves the process, shows as a worst delay per minute."""

from __future__ import annotations

import asyncio

TICK_S = 0.25
WINDOW_S = 60.0


class LagMeter:
    """The worst delays of one loop. `run` belongs to that loop; the rest may be read from anywhere.

    A loop that stood still for some time shows that time, less up to one tick.
    """

    def __init__(self) -> None:
        self._worst_s = 0.0  # in the present minute
        self._before_s = 0.0  # in the minute before it
        self._began_s = float("-inf")
        self._unread_s = 0.0

    @property
    def worst_s(self) -> float:
        """Return the worst delay of the last one to two minutes."""
        return max(self._worst_s, self._before_s)

    def take_worst_s(self) -> float:
        """Return the worst delay since the last call."""
        worst_s, self._unread_s = self._unread_s, 0.0
        return worst_s

    def note(self, delay_s: float, now_s: float) -> None:
        """Record one delay."""
        if now_s - self._began_s >= WINDOW_S:
            self._before_s = self._worst_s if now_s - self._began_s < 2 * WINDOW_S else 0.0
            self._worst_s = 0.0
            self._began_s = now_s
        self._worst_s = max(self._worst_s, delay_s)
        self._unread_s = max(self._unread_s, delay_s)

    async def run(self) -> None:
        """Measure until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due_s = loop.time() + TICK_S
            await asyncio.sleep(TICK_S)
            now_s = loop.time()
            self.note(max(now_s - due_s, 0.0), now_s)
