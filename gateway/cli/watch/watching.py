"""The live table on a terminal, fed by one connection that comes back by itself."""

from __future__ import annotations

import asyncio
import time

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from gateway.cli.broker import Subscription
from gateway.cli.watch.overview import Overview, filters
from gateway.cli.watch.table import STYLES, render
from gateway.mqtt import BrokerSettings, Incoming

DRAWN_EVERY_S = 0.25
SETTLED_S = 2.5  # retained messages have come by then, and two tokens


class Watching:
    """One table of the gateways below a base."""

    def __init__(self, console: Console, settings: BrokerSettings, base: str) -> None:
        self._console = console
        self._overview = Overview(base)
        self._subscription = Subscription(settings, (f"{base}/{each}" for each in filters()), self._take)

    async def show_once(self) -> None:
        """Print the table when all that is retained has come; BrokerError."""
        await asyncio.wait([await self._subscription.connect()], timeout=SETTLED_S)
        self._console.print(self._drawn())

    async def show(self, *, is_full_screen: bool = True) -> None:
        """Draw the table until cancelled; BrokerError only at first."""
        lost = await self._subscription.connect()
        staying = asyncio.create_task(self._subscription.stay(lost))
        try:
            with Live(console=self._console, screen=is_full_screen, auto_refresh=False) as live:
                while True:
                    live.update(self._drawn(), refresh=True)
                    await asyncio.sleep(DRAWN_EVERY_S)
        finally:
            staying.cancel()

    def _drawn(self) -> Group:
        trouble = self._subscription.trouble
        said = [Text(trouble, style=STYLES["F"])] if trouble else []
        return Group(*said, render(self._overview, time.time(), self._console.width))

    def _take(self, message: Incoming) -> None:
        self._overview.take(message.topic, message.payload, time.time())
