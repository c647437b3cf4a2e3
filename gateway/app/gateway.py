"""The gateway's life: it runs its parts, ends in order, applies another site.

Where to start reading: `build.build` makes every part, `App.run` is the order of a start and of an orderly
end, `App.change` that of a reload, which `Reload` reads.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from gateway import __version__
from gateway.app.capture_socket import CaptureSocket
from gateway.app.health import Health
from gateway.app.plant import Plant
from gateway.app.plugins import PluginRunner
from gateway.app.restart import announcement
from gateway.app.site import Site
from gateway.app.uplink import Uplink
from gateway.config import (
    Config,
    ConfigChanges,
    changes_of,
    fixed,
    policy_of,
    rights_of,
    setups_in,
    setups_of,
)
from gateway.contract import EventCode, PublishEvent, ValueRecord, event_of
from gateway.errors import ConfigError, Problem
from gateway.line import LineHost
from gateway.plugins.history.plugin import History
from gateway.starters import Commands, KnownWatchdogs, Policy
from gateway.store import StateStore
from gateway.system.clock import ClockWatch
from gateway.system.gc_tuning import spare_what_lives
from gateway.system.supervised import keep_running
from gateway.system.systemd import Notifier

log = logging.getLogger(__name__)

MOST_REMAINS = 16  # starters that were replaced; clearing their memory stops every loop for a moment
SETTLE_S = 15.0  # for commands to starters that a change takes away; a stop lasts 10 s at most


@dataclass(slots=True, kw_only=True, eq=False)
class App:
    """One gateway, from start to end, with the parts that begin, change or end with it. On the app's loop."""

    site: Site
    publish_event: PublishEvent  # of the gateway's own
    clock_watch: ClockWatch
    state: StateStore
    uplink: Uplink
    policy: Policy
    history: History
    plant: Plant
    host: LineHost
    health: Health
    commands: Commands
    capture: CaptureSocket
    plugins: tuple[PluginRunner, ...]
    _is_up: asyncio.Event = field(init=False, default_factory=asyncio.Event)

    async def run(self, ending: asyncio.Future[str]) -> None:
        """Serve until `ending` has a reason, then end in order: nothing is written to any starter."""
        tasks = [
            asyncio.create_task(keep_running(name, work))
            for name, work in (
                ("health", self.health.run),
                ("publisher", self.uplink.publisher.run),
                ("broker", self.uplink.run),
                ("outbox", self.uplink.disk_sync.run),
                ("commands", self.commands.proofs.run),
                ("capture", self.capture.run),
                *((each.name, each.run) for each in self.plugins),
            )
        ]
        await self.host.start()  # before all else: the starters' watchdogs run
        self.state.start(__version__, on_recalled=self.commands.recall)
        history = asyncio.create_task(self.history.run())
        await self.plant.start()
        self._is_up.set()
        try:
            await self._end(await ending, history)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _end(self, reason: str, history: asyncio.Task[None]) -> None:
        """End in order: commands, lines, starters, then everything that stores, and the connection last."""
        log.info("ending: %s", reason)
        await self._announce_end(reason)
        await self.commands.close()
        await self.host.stop()
        self.plant.end(f"the gateway ended: {reason}")  # published while all that follows is done
        await self.plant.close()
        self.history.end()
        await history
        await self.state.settle()
        await self.uplink.close(reason)
        await self.uplink.end()
        await self.state.close(reason)

    async def _announce_end(self, reason: str) -> None:
        """Publish, while the lines still poll, that they end, and for how long if this is a restart."""
        watchdogs = self.policy.watchdogs
        limits_s = {setup.name: watchdogs.limit_s(setup) for setup in setups_in(self.site.config)}
        self.publish_event(
            await asyncio.to_thread(announcement, reason, self.site.prospects, limit_of=limits_s.get)
        )

    async def change(self, site: Site) -> int:
        """Apply another site and return how many starters that has ended or replaced.

        What is the same in both continues untouched; ConfigError for what needs a restart. All of it takes
        effect at one instant, as soon as no starter that is removed or replaced is under a command, at the
        latest after SETTLE_S: then those commands and stops are cut.
        Nothing is written to any starter.
        """
        before = self.site.config
        problems = fixed(before, site.config)
        problems = problems or await newly_missed(self.policy.watchdogs, before, site.config)
        if problems:
            raise ConfigError(str(site.folder), problems)
        changes = changes_of(before, site.config)
        await self._is_up.wait()
        await self.commands.under_way.settle(changes.starters_gone, within_s=SETTLE_S)
        ended = self._reconfigure(site, changes)
        self.publish_event(EventCode.RELOADED, **changes.to_dict())
        await ended
        await self.uplink.move(site)
        return len(changes.starters_gone)

    def _reconfigure(self, site: Site, changes: ConfigChanges) -> Awaitable[None]:
        """Have every part follow at one instant; what is returned ends what was replaced.

        The plant is first, so that the parts after it still take what its starters publish at their end;
        the others follow in the order of their construction.
        """
        config, rights = site.config, rights_of(site.config)
        self.site = site
        ended = self.plant.reconfigure(changes)
        self.clock_watch.reconfigure(config.gateway.clock)
        self.state.audit.note("gateway_reloaded", "by another configuration from now on")
        self.uplink.reconfigure(config)
        self.policy.motor_history.watch_only(each.name for each in config.starters if each.enabled)
        for name in self.policy.apply(policy_of(config), rights=rights):
            self.plant.starters[name].republish_state()
        self.history.reconfigure(
            setups_in(config),
            changed=changes.starters_gone,
            traced=config.traced,
            has_page=config.web is not None,
        )
        for record in self.uplink.outbox.records():  # what does not change is not published again for long
            if isinstance(record, ValueRecord):
                self.history.series.put(record)
        self.health.reconfigure(self.plant.lines.values(), site)
        self.commands.under_way.reopen()
        self.capture.lines = tuple(self.plant.lines)
        for plugin in self.plugins:
            plugin.reconfigure(site)
        return ended


async def newly_missed(watchdogs: KnownWatchdogs, old: Config, new: Config) -> list[Problem]:
    """Return the watchdogs, as last read from the starters, that only the new configuration would miss."""

    async def missed(config: Config) -> dict[str, str]:
        lines = [await watchdogs.missed_on(setups_of(line)) for line in config.lines]
        return {name: text for found in lines for name, text in found.items()}

    before = await missed(old)
    hint = "leave the line as it was, or make the watchdog longer at the starter"
    return [
        Problem("line.starter", f"{text} (as read from the starter)", hint)
        for name, text in (await missed(new)).items()
        if name not in before
    ]


class Reload:
    """Applies a configuration that is read again; one that cannot be used changes nothing. On the app's loop.

    It is read and validated in a thread; asked again meanwhile, it does so once more.
    """

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
