"""The gateway's life: it runs its parts, ends in order, applies another site.

Where to start reading: `parts.Parts` names every part, `App.run` the order of a start and of an orderly end,
`change` that of a reload.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable

from gateway import __version__
from gateway.app.parts import Parts
from gateway.app.reload import newly_missed
from gateway.app.restart import announcement
from gateway.app.site import Site
from gateway.config.convert import policy_of, rights_of, setups_in
from gateway.config.diff import ConfigChanges, changes_of, fixed
from gateway.contract import EventCode
from gateway.errors import ConfigError
from gateway.system.supervised import keep_running

log = logging.getLogger(__name__)

SETTLE_S = 15.0  # for commands to starters that a change takes away; a stop lasts 10 s at most


class App:
    """One gateway, from start to end. All calls on the app's loop."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self.publish_event = parts.publish_event  # of the gateway's own
        self._is_up = asyncio.Event()

    async def run(self, ending: asyncio.Future[str]) -> None:
        """Serve until `ending` has a reason, then end in order: nothing is written to any starter."""
        parts = self._parts
        tasks = [
            asyncio.create_task(keep_running(name, work))
            for name, work in (
                ("health", parts.health.run),
                ("publisher", parts.uplink.publisher.run),
                ("broker", parts.uplink.run),
                ("outbox", parts.uplink.disk_sync.run),
                ("history", parts.uplink.disk_sync.pace),
                ("commands", parts.commands.run),
                ("capture", parts.capture.run),
                *((each.name, each.run) for each in parts.plugins),
            )
        ]
        await parts.host.start()  # before all else: the starters' watchdogs run
        parts.state.start(__version__, on_recalled=parts.dispatcher.recall)
        self._history = asyncio.create_task(parts.history.run())
        await parts.plant.start()
        self._is_up.set()
        try:
            await self._end(await ending)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _end(self, reason: str) -> None:
        """End in order: commands, lines, starters, then everything that stores, and the connection last."""
        parts = self._parts
        log.info("ending: %s", reason)
        await self._announce_end(reason)
        await parts.dispatcher.close()
        await parts.host.stop()
        parts.plant.end(f"the gateway ended: {reason}")  # published while all that follows is done
        await parts.plant.close()
        await parts.services.close()
        parts.history.end()
        await self._history
        await parts.state.settle()
        await parts.uplink.close(reason)
        await parts.uplink.end()
        await parts.state.close(reason)

    async def _announce_end(self, reason: str) -> None:
        """Publish, while the lines still poll, that they end, and for how long if this is a restart."""
        parts = self._parts
        limits_s = {setup.name: parts.watchdogs.limit_s(setup) for setup in setups_in(parts.site.config)}
        parts.publish_event(
            await asyncio.to_thread(announcement, reason, parts.site.prospects, limit_of=limits_s.get)
        )

    async def change(self, site: Site) -> int:
        """Apply another site and return how many starters that has ended or replaced.

        What is the same in both continues untouched; ConfigError for what needs a restart. All of it takes
        effect at one instant, as soon as no starter that is removed or replaced is under a command.
        Nothing is written to any starter.
        """
        parts = self._parts
        problems = fixed(parts.site.config, site.config)
        problems = problems or await newly_missed(parts.watchdogs, parts.site.config, site.config)
        if problems:
            raise ConfigError(str(site.folder), problems)
        changes = changes_of(parts.site.config, site.config)
        await self._is_up.wait()
        await parts.dispatcher.settle(changes.starters_gone, within_s=SETTLE_S)
        ended = self._apply(site, changes)
        parts.publish_event(EventCode.RELOADED, **changes.to_dict())
        await ended
        await parts.uplink.move(site)
        return len(changes.starters_gone)

    def _apply(self, site: Site, changes: ConfigChanges) -> Awaitable[None]:
        """Do everything that must happen at one instant; what is returned ends what was replaced."""
        parts = self._parts
        config, has_operators = site.config, bool(site.config.operators)
        parts.site = site
        ended = parts.plant.apply(changes)
        parts.history.reconfigure(setups_in(config), changed=changes.starters_gone)
        parts.state.apply(has_operators=has_operators)
        for name in parts.policy.apply(policy_of(config), rights=rights_of(config)):
            parts.plant.starters[name].republish_state()
        parts.dispatcher.apply_rights(rights_of(config))
        parts.clock_watch.trust(config.gateway.clock)
        parts.capture.lines = tuple(parts.plant.lines)
        parts.watch_lines()
        parts.forget_lines(changes.lines_forgotten)
        parts.uplink.publish_info(config)
        for plugin in parts.plugins:
            plugin.reconfigure(site)
        return ended
