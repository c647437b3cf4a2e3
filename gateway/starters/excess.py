"""Refuses commands that are too many: one by one while that is bearable, else together, by their number."""

from __future__ import annotations

import asyncio
from collections.abc import Hashable
from dataclasses import replace

from gateway.starters.errand import Desk, End, Errand
from gateway.starters.flood import TELL_EVERY_S, Damper
from gateway.starters.records import Phase
from gateway.starters.request import CommandRequest

TOO_MANY = "too_many"


class Excess:
    """Tells each client at most ten times a second that commands were refused."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._damper = Damper()
        self._last: dict[Hashable, CommandRequest] = {}  # of those that were only counted
        self._timers: dict[Hashable, asyncio.TimerHandle] = {}

    def refuse(self, client: Hashable, request: CommandRequest, text: str) -> None:
        """Refuse a command now, or count it."""
        if self._damper.passes(client, now_s=self._desk.clock.now_s()):
            self._tell(request, End(Phase.REJECTED, TOO_MANY, text))
            return
        self._last[client] = request
        if client not in self._timers:
            loop = asyncio.get_running_loop()
            self._timers[client] = loop.call_later(TELL_EVERY_S, self._tell_number, client)

    def close(self) -> None:
        """Tell now what is still untold."""
        for client, timer in tuple(self._timers.items()):
            timer.cancel()
            self._tell_number(client)

    def _tell_number(self, client: Hashable) -> None:
        del self._timers[client]
        count = self._damper.take(client, now_s=self._desk.clock.now_s())
        request = replace(self._last.pop(client), id=None, correlation=None, response_topic=None)
        text = f"{count} more refused: too many commands at once"
        self._tell(request, End(Phase.REJECTED, TOO_MANY, text, values={"count": count}))

    def _tell(self, request: CommandRequest, end: End) -> None:
        Errand(request, self._desk).finish(end, is_kept=False)
