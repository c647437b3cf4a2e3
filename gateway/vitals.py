"""Whether the gateway lives: readiness, the service watchdog, its status, and how each line does.

systemd is told READY once every line has made its first step (a transaction, or an attempt to open its port)
and WATCHDOG only after every line has made another one: what feeds it is the lines' work, not a timer.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence

from gateway.line.client import LineClient
from gateway.mqtt.publisher import Publisher
from gateway.starters.records import LineRecord
from gateway.systemd import Notifier

log = logging.getLogger(__name__)

FIGURES_EVERY_S = 30.0
SETTLING_S = 1.5  # after a change; a line's figures are up to a second old
LOOK_EVERY_S = 0.25


class Vitals:
    """Watches the lines and speaks for them; all calls on the app's loop."""

    def __init__(
        self,
        lines: Sequence[LineClient],
        *,
        progress: Callable[[], Mapping[str, int]],
        publisher: Publisher,
        notifier: Notifier,
        watchdog_every_s: float | None,
    ) -> None:
        self._lines = lines
        self._progress = progress  # by line: grows with each step of its loop
        self._publisher = publisher
        self._notifier = notifier
        self._watchdog_every_s = watchdog_every_s
        self._port_troubles: dict[str, str] = {}
        self._link_trouble = ""
        self._is_ready = False
        self._is_changed = False

    def note_port(self, line: str, trouble: str) -> None:
        """Take over that a line's port is open (empty) or away (why)."""
        if trouble:
            self._port_troubles[line] = trouble
        else:
            self._port_troubles.pop(line, None)
        self._tell_status()
        self._is_changed = True

    def note_link(self, trouble: str) -> None:
        """Take over what is wrong with the connection to the broker; empty for nothing."""
        self._link_trouble = trouble
        self._tell_status()

    def note_change(self) -> None:
        """Take over that the lines' figures have changed in a way that people wait for."""
        self._is_changed = True

    async def run(self) -> None:
        """Watch for ever."""
        loop = asyncio.get_running_loop()
        seen = self._progress()
        figures_due_s = fed_s = loop.time()
        while True:
            now_s = loop.time()
            if not self._is_ready and all(self._progress().values()):
                self._become_ready()
            if self._watchdog_every_s is not None and now_s - fed_s >= self._watchdog_every_s:
                progress = self._progress()
                if all(progress[name] != seen[name] for name in progress):
                    self._notifier.watchdog()
                    seen, fed_s = progress, now_s
            if self._is_changed:
                self._is_changed = False
                figures_due_s = min(figures_due_s, now_s + SETTLING_S)
            if now_s >= figures_due_s:
                self._put_figures()
                figures_due_s = now_s + FIGURES_EVERY_S
            await asyncio.sleep(LOOK_EVERY_S)

    def _become_ready(self) -> None:
        self._is_ready = True
        self._tell_status()
        self._notifier.ready(f"polling {len(self._lines)} line(s)")
        log.info("lines=%s polling", ",".join(line.name for line in self._lines))

    def _tell_status(self) -> None:
        if not self._is_ready:
            return
        troubles = [f"line {line}: {trouble}" for line, trouble in self._port_troubles.items()]
        troubles += [self._link_trouble] if self._link_trouble else []
        self._publisher.set_status("degraded" if troubles else "online", "; ".join(troubles) or None)
        self._notifier.status("; ".join(troubles) or "polling")

    def _put_figures(self) -> None:
        for line in self._lines:
            self._publisher.put(LineRecord(line.name, line.figures()))
