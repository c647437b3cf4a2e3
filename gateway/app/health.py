"""Health: readiness, the service watchdog, the status of the gateway, and the statistics of each line.

systemd gets READY once every line has made its first step (a transaction, or an attempt to open its port),
and WATCHDOG only after every line has made another one: what feeds it is the lines' work, not a timer.
`Saturation` finds lines without time to spare, `WatchdogAlarm` watchdogs that a line does not serve in time.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from gateway.contract import Event, EventCode, LineRecord, PublishEvent, Severity, Sink, event_of
from gateway.line import CableHealth, LineClient, WiredStarter, capacity
from gateway.mqtt import Publisher
from gateway.system.rate_limits import HoldOff
from gateway.system.stalls import HangWatch, LagMeter
from gateway.system.systemd import Notifier

log = logging.getLogger(__name__)

STATISTICS_EVERY_S = 30.0
SETTLING_S = 1.5  # after a change; a line's statistics are up to a second old
LAG_WARNS_S = 0.05
LAG_QUIET_S = 60.0  # a loop that was in time for so long may be reported again
QUIET_S = 300.0  # without another, before a starter that was left for too long may be reported again

FULL = 0.95  # of a line's time
RELIEVED = 0.90
FOR_S = 60.0  # before a line counts as full, or as relieved


class Saturation:
    """Watches one line's utilisation; a change is reported once it has lasted for a minute."""

    def __init__(self) -> None:
        self._is_full = False
        self._since_s: float | None = None  # when it began to look otherwise

    def take(self, utilisation: float, now_s: float) -> bool | None:
        """Return whether the line is full when that has just changed, None otherwise."""
        is_otherwise = utilisation < RELIEVED if self._is_full else utilisation > FULL
        if not is_otherwise:
            self._since_s = None
            return None
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s < FOR_S:
            return None
        self._is_full, self._since_s = not self._is_full, None
        return self._is_full


class WatchdogAlarm:
    """Watches one line's `watchdogs` statistics; a change is reported once."""

    def __init__(self, line: str) -> None:
        self._line = line
        self._is_full = False  # the watchdogs need more than there is
        self._missed: dict[int, HoldOff] = {}  # by unit

    def take(self, statistics: Mapping[str, float | int], now_s: float) -> Event | None:
        """Return what is wrong when that is news, None otherwise."""
        load, share, unit = statistics["load"], statistics["longest_share"], int(statistics["unit"])
        was_full, self._is_full = self._is_full, load > 1.0
        is_missed = share >= 1.0 and self._missed.setdefault(unit, HoldOff(QUIET_S)).sounds(now_s)
        if self._is_full and not was_full:
            return event_of(EventCode.WATCHDOG_UNKEPT, "overload", line=self._line, load=load)
        if is_missed:
            return event_of(EventCode.WATCHDOG_UNKEPT, "missed", line=self._line, unit=unit, share=share)
        return None


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
        hangs: HangWatch | None = None,
    ) -> None:
        self._progress = progress  # by line: grows with each step of its loop
        self._publisher = publisher
        self._sink = sink
        self._notifier = notifier
        self._watchdog_every_s = watchdog_every_s  # half of systemd's limit
        self._hangs = hangs or HangWatch(watchdog_every_s)
        self._publish_event = publish_event
        self.lag = LagMeter()  # of the application's loop
        self._lines_lag = lines_lag
        self._lag_watches = (
            _LagWatch("the gateway's own loop", self.lag, publish_event),
            _LagWatch("the lines' loop", lines_lag, publish_event),
        )
        self._lines: tuple[LineClient, ...] = ()
        self._computed: Mapping[str, Mapping[str, Any]] = {}
        self._saturations: dict[str, Saturation] = {}  # of lines that should have time to spare
        self._watchdog_alarms: dict[str, WatchdogAlarm] = {}
        self._cables: dict[str, CableHealth] = {}
        self._port_troubles: dict[str, str] = {}
        self._starter_troubles: dict[str, str] = {}
        self._link_trouble: str | None = ""
        self._is_ready = False
        self._is_changed = False

    def watch(
        self,
        lines: Iterable[LineClient],
        *,
        shortest_watchdog_s: float | None,
        computed: Mapping[str, Mapping[str, Any]],
        wiring: Mapping[str, Sequence[WiredStarter]],
    ) -> None:
        """Watch these lines from now on.

        By line, `computed` holds its computed worst-case statistics, `wiring` its starters in the order in
        which the cable passes them.
        """
        self._lines = tuple(lines)
        self._computed = computed
        paced = [name for name, statistics in computed.items() if statistics["is_paced"]]
        self._saturations = {name: self._saturations.get(name, Saturation()) for name in paced}
        names = {line.name for line in self._lines}
        self._port_troubles = {n: trouble for n, trouble in self._port_troubles.items() if n in names}
        self._watchdog_alarms = {n: alarm for n, alarm in self._watchdog_alarms.items() if n in names}
        for name in self._cables.keys() - wiring.keys():
            del self._cables[name]
        for name, starters in wiring.items():
            self._cables.setdefault(name, CableHealth(starters)).rewire(starters)
        for watch in self._lag_watches:
            watch.shortest_watchdog_s = shortest_watchdog_s
        self._publish_status()
        self._is_changed = True

    def note_port(self, line: str, trouble: str) -> None:
        """Record that a line's port is open (empty) or away (why)."""
        if trouble:
            self._port_troubles[line] = trouble
        else:
            self._port_troubles.pop(line, None)
        self._publish_status()
        self._is_changed = True

    def note_starter(self, starter: str, trouble: str) -> None:
        """Record that a part of a starter cannot be read, and why; empty when all of it can."""
        if trouble:
            self._starter_troubles[starter] = trouble
        else:
            self._starter_troubles.pop(starter, None)
        self._publish_status()

    def note_link(self, trouble: str | None) -> None:
        """Record what is wrong with the connection to the broker; empty for nothing, None: still starting."""
        self._link_trouble = trouble
        self._publish_status()

    def note_change(self) -> None:
        """Publish the lines' statistics soon: they have changed in a way that people wait for."""
        self._is_changed = True

    async def run(self) -> None:
        """Watch until cancelled."""
        measuring = asyncio.create_task(self.lag.run(), name="lag")
        try:
            await self._watch()
        finally:
            self._hangs.close()
            measuring.cancel()

    async def _watch(self) -> None:
        loop = asyncio.get_running_loop()
        seen = self._progress()
        statistics_due_s = fed_s = loop.time()
        self._hangs.fed()
        while True:
            now_s = loop.time()
            if not self._is_ready and all(self._progress().values()):
                self._become_ready()
            if (
                self._watchdog_every_s is not None
                and now_s - fed_s >= 2 * self._watchdog_every_s / capacity.FEEDS
            ):
                progress = self._progress()
                if all(steps != seen.get(name) for name, steps in progress.items()):
                    self._notifier.watchdog()
                    self._hangs.fed()
                    seen, fed_s = progress, now_s
            for watch in self._lag_watches:
                watch.look(now_s)
            self._check_load(now_s)
            if self._is_changed:
                self._is_changed = False
                statistics_due_s = min(statistics_due_s, now_s + SETTLING_S)
            if now_s >= statistics_due_s:
                self._publish_statistics()
                statistics_due_s = now_s + STATISTICS_EVERY_S
            await asyncio.sleep(capacity.LOOK_S)

    def _become_ready(self) -> None:
        self._is_ready = True
        self._publish_status()
        self._notifier.ready(f"polling {len(self._lines)} line(s)")
        log.info("lines=%s polling", ",".join(line.name for line in self._lines))

    def _publish_status(self) -> None:
        if not self._is_ready:
            return
        troubles = [f"line {line}: {trouble}" for line, trouble in self._port_troubles.items()]
        troubles += [f"starter {name}: {trouble}" for name, trouble in self._starter_troubles.items()]
        troubles += [self._link_trouble] if self._link_trouble else []
        if self._link_trouble is None:
            self._publisher.set_status("starting")
        else:
            self._publisher.set_status("degraded" if troubles else "online", "; ".join(troubles) or None)
        self._notifier.status("; ".join(troubles) or "polling")

    def _check_load(self, now_s: float) -> None:
        """Publish when a line is saturated, and when no longer; watchdogs first."""
        for line in self._lines:
            statistics = line.statistics()
            self._check_watchdogs(line.name, statistics, now_s)
            saturation = self._saturations.get(line.name)
            if saturation is None:
                continue
            is_full = saturation.take(statistics.get("utilisation", 0.0), now_s)
            if is_full:
                self._publish_event(EventCode.LINE_SATURATED, line=line.name, seconds=FOR_S)
            elif is_full is not None:
                self._publish_event(EventCode.LINE_RELIEVED, line=line.name)

    def _check_watchdogs(self, line: str, statistics: Mapping[str, Any], now_s: float) -> None:
        """Publish which watchdogs this line does not serve in time, those read from the starters included."""
        if "watchdogs" not in statistics:
            return
        alarm = self._watchdog_alarms.setdefault(line, WatchdogAlarm(line))
        unkept = alarm.take(statistics["watchdogs"], now_s)
        if unkept is not None:
            self._publish_event(unkept)

    def _publish_statistics(self) -> None:
        lag_s = {"line": round(self._lines_lag.worst_s, 4), "gateway": round(self.lag.worst_s, 4)}
        for line in self._lines:
            statistics = line.statistics()
            computed = {"computed": self._computed[line.name]} if line.name in self._computed else {}
            more = {**computed, **self._cable_of(line.name, statistics), "lag_s": lag_s}
            self._sink.put(LineRecord(line=line.name, data={**statistics, **more}))

    def _cable_of(self, line: str, statistics: Mapping[str, Any]) -> dict[str, Any]:
        """Return what the errors on a line say of its cable; report what has changed in that."""
        cable = self._cables.get(line)
        if cable is None:
            return {}
        changes = cable.take(statistics, asyncio.get_running_loop().time())
        for text in changes.appeared:
            self._publish_event(EventCode.CABLE, "found", severity=Severity.WARNING, line=line, finding=text)
        for text in changes.gone:
            self._publish_event(EventCode.CABLE, "gone", severity=Severity.INFO, line=line, finding=text)
        return {"cable": cable.to_dict()}


class _LagWatch:
    """Reports one loop's delays: the first that is too long, and again only after a minute without one."""

    shortest_watchdog_s: float | None = None

    def __init__(self, what: str, meter: LagMeter, publish_event: PublishEvent) -> None:
        self._what = what
        self._meter = meter
        self._publish_event = publish_event
        self._warning, self._alarm = HoldOff(LAG_QUIET_S), HoldOff(LAG_QUIET_S)

    def look(self, now_s: float) -> None:
        worst_s = self._meter.take_worst_s()
        if worst_s > (self.shortest_watchdog_s or float("inf")) / 3 and self._alarm.sounds(now_s):
            self._publish_event(EventCode.LAG, loop=self._what, late_s=worst_s)
        if worst_s > LAG_WARNS_S and self._warning.sounds(now_s):
            text = "%s was %.3f s late; it is logged once, the worst is in the line's statistics"
            log.warning(text, self._what, worst_s)
