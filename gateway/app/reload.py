"""Applies another configuration while the gateway runs; one that cannot be used changes nothing."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from gateway.app.site import Site
from gateway.config.convert import setups_of
from gateway.config.schema import Config
from gateway.contract import EventCode, event_of
from gateway.errors import ConfigError, Problem
from gateway.starters import KnownWatchdogs
from gateway.system.gc_tuning import spare_what_lives
from gateway.system.systemd import Notifier

if TYPE_CHECKING:
    from gateway.app.gateway import App

log = logging.getLogger(__name__)

MOST_REMAINS = 16  # starters that were replaced; clearing their memory stops every loop for a moment


async def newly_missed(watchdogs: KnownWatchdogs, old: Config, new: Config) -> list[Problem]:
    """Return the watchdogs, as last read from the starters, that only the new configuration would miss."""

    async def missed(config: Config) -> dict[str, str]:
        lines = [await watchdogs.missed_on(setups_of(line)) for line in config.lines]
        return {name: text for found in lines for name, text in found.items()}

    before = await missed(old)
    hint = "leave the line as it was, or make the watchdog longer at the starter"
    return [
        Problem("line.starter", f"{name}: {text} (as read from the starter)", hint)
        for name, text in (await missed(new)).items()
        if name not in before
    ]


class Reload:
    """Reads and validates in a thread; asked again meanwhile, it does so once more. On the app's loop."""

    def __init__(self, read: Callable[[], Site], running: App, notifier: Notifier) -> None:
        self._read = read
        self._running = running
        self._notifier = notifier
        self._task: asyncio.Task[None] | None = None
        self._is_asked_again = False
        self._remains = 0

    def begin(self) -> None:
        """Read the configuration and apply it, as soon as a reload under way is done."""
        self._is_asked_again = True
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._run(), name="reload")

    def cancel(self) -> None:
        """Do nothing more: the gateway ends."""
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        try:
            while self._is_asked_again:
                self._is_asked_again = False
                self._notifier.reloading()
                self._notifier.ready(await self._reloaded())  # also when refused: the old one is in force
        finally:
            self._task = None

    async def _reloaded(self) -> str:
        try:
            site = await asyncio.to_thread(self._read)
            self._remains += await self._running.change(site)
        except ConfigError as error:
            return self._refused([str(problem) for problem in error.problems])
        except Exception:  # the guard at the task's top
            log.exception("the reload ended by a bug")
            failed = event_of(EventCode.RELOAD_FAILED)
            self._running.publish_event(failed)
            return failed.text
        is_much = self._remains >= MOST_REMAINS
        spare_what_lives(with_look=is_much)
        self._remains = 0 if is_much else self._remains
        return "polling; the new configuration is in force"

    def _refused(self, mistakes: list[str]) -> str:
        for mistake in mistakes:
            log.error("reload refused: %s", mistake)
        first, more = mistakes[0], len(mistakes) - 1
        if more:
            refused = event_of(EventCode.RELOAD_REFUSED, "several", mistakes=mistakes, first=first, more=more)
        else:
            refused = event_of(EventCode.RELOAD_REFUSED, "one", mistakes=mistakes, first=first)
        self._running.publish_event(refused)
        return refused.text
