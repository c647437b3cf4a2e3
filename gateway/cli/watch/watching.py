"""The live table on a terminal, fed by one connection that comes back by itself."""

from __future__ import annotations

import asyncio
import os
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress

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
        """Draw the table until cancelled, or on the full screen until q; BrokerError only at first."""
        lost = await self._subscription.connect()
        staying = asyncio.create_task(self._subscription.stay(lost))
        quitting = asyncio.Event()
        has_keys = is_full_screen and sys.stdin.isatty()
        try:
            with (
                _pressed("q", quitting.set) if has_keys else nullcontext(),
                Live(console=self._console, screen=is_full_screen, auto_refresh=False) as live,
            ):
                while not quitting.is_set():
                    live.update(self._drawn(), refresh=True)
                    with suppress(TimeoutError):
                        await asyncio.wait_for(quitting.wait(), DRAWN_EVERY_S)
        finally:
            staying.cancel()

    def _drawn(self) -> Group:
        table = render(self._overview, time.time(), self._console.width)
        trouble = self._subscription.trouble
        return Group(*([Text(trouble, style=STYLES["F"])] if trouble else []), *table.renderables)

    def _take(self, message: Incoming) -> None:
        self._overview.take(message.topic, message.payload, time.time())


@contextmanager
def _pressed(key: str, on_key: Callable[[], None]) -> Iterator[None]:
    """Take single keys from the terminal, without an echo."""
    terminal, loop = sys.stdin.fileno(), asyncio.get_running_loop()

    def read() -> None:
        if key.encode() in os.read(terminal, 64):
            on_key()

    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)
    loop.add_reader(terminal, read)
    try:
        yield
    finally:
        loop.remove_reader(terminal)
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
