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

from gateway.cli.watch.overview import Overview, filters
from gateway.cli.watch.table import STYLES, render
from gateway.errors import BrokerError
from gateway.mqtt import BrokerSettings, Incoming, connected

DRAWN_EVERY_S = 0.25
SETTLED_S = 2.5  # retained messages have come by then, and two tokens
AGAIN_S = 2.0


class Watching:
    """One table of the gateways below a base."""

    def __init__(self, console: Console, settings: BrokerSettings, base: str) -> None:
        self._console = console
        self._settings = settings
        self._base = base
        self._overview = Overview(base)
        self._trouble = ""

    async def show_once(self) -> None:
        """Print the table when all that is retained has come; BrokerError."""
        await asyncio.wait([await self._connect()], timeout=SETTLED_S)
        self._console.print(self._drawn())

    async def show(self, *, is_full_screen: bool = True) -> None:
        """Draw the table until cancelled, or on the full screen until q; BrokerError only at first."""
        staying = asyncio.create_task(self._stay_connected(await self._connect()))
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
        table = render(self._overview, time.time())
        trouble = [Text(self._trouble, style=STYLES["F"])] if self._trouble else []
        return Group(*trouble, *table.renderables)

    async def _stay_connected(self, lost: asyncio.Future[str]) -> None:
        while True:
            await asyncio.wait([lost])
            self._trouble = f"the connection to {self._settings.address} is lost; trying again"
            await asyncio.sleep(AGAIN_S)
            try:
                lost, self._trouble = await self._connect(), ""
            except BrokerError as error:
                self._trouble = str(error)

    async def _connect(self) -> asyncio.Future[str]:
        """Connect and subscribe; what is returned is done when the connection is lost."""
        session, _ = await connected(self._settings, on_incoming=self._take)
        for topic in (f"{self._base}/{each}" for each in filters()):
            if not await session.subscribe(topic, with_retained=True):
                session.abort()
                raise BrokerError(
                    f"broker {self._settings.address} does not let {topic} be read",
                    "log in with --username, or look at its access list",
                )
        return session.lost

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
