"""Health: readiness, the service watchdog, the status of the gateway, and the statistics of its lines.

systemd gets READY once every line has made its first step (a transaction, or an attempt to open its port),
and WATCHDOG only after every line has made another one: what feeds it is the lines' work, not a timer.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping

from gateway.app.site import Site
from gateway.app.watched_line import WatchedLine
from gateway.config import least_watchdog_s, wiring_of
from gateway.contract import EventCode, PublishEvent, Sink
from gateway.line import LineClient, capacity
from gateway.mqtt import Publisher
from gateway.system.rate_limits import HoldOff
from gateway.system.stalls import LagMeter
from gateway.system.supervised import until_first
from gateway.system.systemd import Notifier

log = logging.getLogger(__name__)

STATISTICS_EVERY_S = 30.0
SETTLING_S = 1.5  # after a change; a line's statistics are up to a second old
LAG_WARNS_S = 0.05
LAG_QUIET_S = 60.0  # a loop that was in time for so long may be reported again

LINE, STARTER = "line", "starter"  # where a trouble is; in this order in the status


class Health:
    """Watches the lines and publishes their state; all calls on the app's loop."""

    def __init__(
        self,
        *,
        progress: Callable[[], Mapping[str, int]],
        publisher: Publisher,
        sink: Sink,
        notifier: Notifier,
        watchdog_every_s: float | None,
        lines_lag: LagMeter,
        publish_event: PublishEvent,
    ) -> None:
        self._progress = progress  # by line: grows with each step of its loop
        self._publisher = publisher
        self._sink = sink
        self._notifier = notifier
        self._watchdog_every_s = watchdog_every_s  # half of systemd's limit
        self._publish_event = publish_event
        self.lag = LagMeter()  # of the application's loop
        self._lag_watches = (
            _LagWatch("the gateway's own loop", self.lag, publish_event),
            _LagWatch("the lines' loop", lines_lag, publish_event),
        )
        self._lines: dict[str, WatchedLine] = {}
        self._troubles: dict[tuple[str, str], str] = {}  # by LINE or STARTER, and its name
        self._link_trouble: str | None = None  # None: the connection is not judged yet
        self._is_ready = False
        self._is_changed = False

    def reconfigure(self, lines: Iterable[LineClient], site: Site) -> None:
        """Watch these lines of a site from now on."""
        shortest_watchdog_s, wiring = least_watchdog_s(site.config), wiring_of(site.config)
        before, self._lines = self._lines, {}
        for line in lines:
            watched = before.get(line.name)
            if watched is None or watched.line is not line:
                watched = WatchedLine(line, self._publish_event)
            watched.reconfigure(site.computed.get(line.name, {}), wiring.get(line.name))
            self._lines[line.name] = watched
        for place in [place for place in self._troubles if place[0] == LINE and place[1] not in self._lines]:
            del self._troubles[place]
        for watch in self._lag_watches:
            watch.shortest_watchdog_s = shortest_watchdog_s
        self._publish_status()
        self._is_changed = True

    def note_port(self, line: str, trouble: str) -> None:
        """Record that a line's port is open (empty) or away (why)."""
        self._note((LINE, line), trouble)
        self._is_changed = True

    def note_starter(self, starter: str, trouble: str) -> None:
        """Record that a part of a starter cannot be read, and why; empty when all of it can."""
        self._note((STARTER, starter), trouble)

    def note_link(self, trouble: str | None) -> None:
        """Record what is wrong with the connection to the broker; empty for nothing, None: still starting."""
        self._link_trouble = trouble
        self._publish_status()

    def note_change(self) -> None:
        """Publish the lines' statistics soon: they have changed in a way that people wait for."""
        self._is_changed = True

    async def run(self) -> None:
        """Watch until cancelled."""
        await until_first(self._watch(), self.lag.run())

    async def _watch(self) -> None:
        loop = asyncio.get_running_loop()
        seen = self._progress()
        statistics_due_s = fed_s = loop.time()
        while True:
            now_s = loop.time()
            if not self._is_ready and all(self._progress().values()):
                self._become_ready()
            # The service watchdog is fed in half of its time, and only when each line has moved since.
            limit_s = self._watchdog_every_s
            is_due = limit_s is not None and now_s - fed_s >= 2 * limit_s / capacity.FEEDS
            progress = self._progress() if is_due else {}
            if is_due and all(steps != seen.get(name) for name, steps in progress.items()):
                self._notifier.watchdog()
                seen, fed_s = progress, now_s
            for watch in self._lag_watches:
                watch.look(now_s)
            for line in self._lines.values():
                line.look(now_s)
            # Statistics come every 30 s; a change brings them forward, once its counters are in them.
            if self._is_changed:
                self._is_changed = False
                statistics_due_s = min(statistics_due_s, now_s + SETTLING_S)
            if now_s >= statistics_due_s:
                self._publish_statistics(now_s)
                statistics_due_s = now_s + STATISTICS_EVERY_S
            await asyncio.sleep(capacity.LOOK_S)

    def _become_ready(self) -> None:
        self._is_ready = True
        self._publish_status()
        self._notifier.ready(f"polling {len(self._lines)} line(s)")
        log.info("lines=%s polling", ",".join(self._lines))

    def _note(self, place: tuple[str, str], trouble: str) -> None:
        self._troubles.pop(place, None)
        if trouble:
            self._troubles[place] = trouble
        self._publish_status()

    def _publish_status(self) -> None:
        if not self._is_ready:
            return
        troubles = [f"{kind} {name}: {trouble}" for (kind, name), trouble in sorted(self._troubles.items())]
        troubles += [self._link_trouble] if self._link_trouble else []
        if self._link_trouble is None:
            self._publisher.set_status("starting")
        else:
            self._publisher.set_status("degraded" if troubles else "online", "; ".join(troubles) or None)
        self._notifier.status("; ".join(troubles) or "polling")

    def _publish_statistics(self, now_s: float) -> None:
        own, lines = self._lag_watches
        lag_s = {"line": round(lines.worst_s, 4), "gateway": round(own.worst_s, 4)}
        own.worst_s = lines.worst_s = 0.0
        for line in self._lines.values():
            self._sink.put(line.record(lag_s, now_s))


class _LagWatch:
    """Reports one loop's delays: the first that is too long, and again only after a minute without one."""

    shortest_watchdog_s: float | None = None
    worst_s = 0.0  # since the latest statistics

    def __init__(self, what: str, meter: LagMeter, publish_event: PublishEvent) -> None:
        self._what = what
        self._meter = meter
        self._publish_event = publish_event
        self._warning, self._alarm = HoldOff(LAG_QUIET_S), HoldOff(LAG_QUIET_S)

    def look(self, now_s: float) -> None:
        worst_s = self._meter.take_worst_s()
        self.worst_s = max(self.worst_s, worst_s)
        if worst_s > (self.shortest_watchdog_s or float("inf")) / 3 and self._alarm.sounds(now_s):
            self._publish_event(EventCode.LAG, loop=self._what, late_s=worst_s)
        if worst_s > LAG_WARNS_S and self._warning.sounds(now_s):
            text = "%s was %.3f s late; it is logged once, the worst is in the line's statistics"
            log.warning(text, self._what, worst_s)
