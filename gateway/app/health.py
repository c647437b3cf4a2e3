"""Whether the gateway lives: readiness, the service watchdog, its status, and how each line does.

systemd is told READY once every line has made its first step (a transaction, or an attempt to open its port)
and WATCHDOG only after every line has made another one: what feeds it is the lines' work, not a timer.

Whether a line has had no time to spare for long: then values get older than their periods say.

Whether a line keeps its starters from their communication watchdogs; those found at run time, too.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from gateway.line.capacity.outage import FEEDS, LOOK_S
from gateway.line.client import LineClient
from gateway.mqtt.publisher import Publisher
from gateway.records import LineRecord, Severity, Sink
from gateway.system.hang_dump import HangWatch
from gateway.system.loop_lag import LagMeter
from gateway.system.once import Alarm
from gateway.system.systemd import Notifier

FULL = 0.95  # of its time
RELIEVED = 0.90
FOR_S = 60.0


class Saturation:
    """Watches one line's utilisation; a change is told once it has lasted for a minute."""

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


QUIET_S = 300.0  # without another, before a starter that was left for too long may be told of again


class WatchdogAlarm:
    """Watches one line's `watchdogs` figures; what has changed is told once."""

    def __init__(self) -> None:
        self._is_full = False  # the watchdogs need more than there is
        self._missed: dict[int, Alarm] = {}  # by unit

    def take(self, figures: Mapping[str, float | int], now_s: float) -> str | None:
        """Return what is wrong when that is news, None otherwise."""
        load, share, unit = figures["load"], figures["longest_share"], int(figures["unit"])
        was_full, self._is_full = self._is_full, load > 1.0
        told = None
        if self._is_full and not was_full:
            told = f"the starters' watchdogs need {load:.0%} of its time and cannot all be kept"
        if share >= 1.0 and self._missed.setdefault(unit, Alarm(QUIET_S)).sounds(now_s):
            told = (
                told or f"address {unit} was left for {share:.0%} of its watchdog's time: it may have acted"
            )
        return told


log = logging.getLogger(__name__)

FIGURES_EVERY_S = 30.0
SETTLING_S = 1.5  # after a change; a line's figures are up to a second old
LAG_WARNS_S = 0.05
LAG_QUIET_S = 60.0  # a loop that was in time for so long may be told of again

Tell = Callable[[str, Severity, str], None]


class Health:
    """Watches the lines and speaks for them; all calls on the app's loop."""

    def __init__(
        self,
        lines: Iterable[LineClient],
        *,
        progress: Callable[[], Mapping[str, int]],
        publisher: Publisher,
        sink: Sink,
        notifier: Notifier,
        watchdog_every_s: float | None,
        lines_lag: LagMeter,
        shortest_watchdog_s: float | None,
        tell: Tell,
        hangs: HangWatch | None = None,
        computed: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        self._progress = progress  # by line: grows with each step of its loop
        self._publisher = publisher
        self._sink = sink
        self._notifier = notifier
        self._watchdog_every_s = watchdog_every_s  # half of systemd's limit
        self._hangs = hangs or HangWatch(watchdog_every_s)
        self._tell = tell
        self._lag = LagMeter()
        self._lines_lag = lines_lag
        self._lag_watches = (
            _LagWatch("the gateway's own loop", self._lag, tell),
            _LagWatch("the lines' loop", lines_lag, tell),
        )
        self._saturations: dict[str, Saturation] = {}  # of lines that should have time to spare
        self._watchdog_alarms: dict[str, WatchdogAlarm] = {}
        self._port_troubles: dict[str, str] = {}
        self._starter_troubles: dict[str, str] = {}
        self._link_trouble = ""
        self._is_ready = False
        self._is_changed = False
        self.watch(lines, shortest_watchdog_s=shortest_watchdog_s, computed=computed or {})

    def watch(
        self,
        lines: Iterable[LineClient],
        *,
        shortest_watchdog_s: float | None,
        computed: Mapping[str, Mapping[str, Any]],
    ) -> None:
        """Watch these lines from now on; `computed` is, by line, what its figures should be."""
        self._lines = tuple(lines)
        self._computed = computed
        paced = [name for name, figures in computed.items() if figures["is_paced"]]
        self._saturations = {name: self._saturations.get(name, Saturation()) for name in paced}
        names = {line.name for line in self._lines}
        self._port_troubles = {n: trouble for n, trouble in self._port_troubles.items() if n in names}
        self._watchdog_alarms = {n: alarm for n, alarm in self._watchdog_alarms.items() if n in names}
        for watch in self._lag_watches:
            watch.shortest_watchdog_s = shortest_watchdog_s
        self._tell_status()
        self._is_changed = True

    def note_port(self, line: str, trouble: str) -> None:
        """Take over that a line's port is open (empty) or away (why)."""
        if trouble:
            self._port_troubles[line] = trouble
        else:
            self._port_troubles.pop(line, None)
        self._tell_status()
        self._is_changed = True

    def note_starter(self, starter: str, trouble: str) -> None:
        """Take over that a part of a starter cannot be read, and why; empty when all of it can."""
        if trouble:
            self._starter_troubles[starter] = trouble
        else:
            self._starter_troubles.pop(starter, None)
        self._tell_status()

    def note_link(self, trouble: str) -> None:
        """Take over what is wrong with the connection to the broker; empty for nothing."""
        self._link_trouble = trouble
        self._tell_status()

    def note_change(self) -> None:
        """Take over that the lines' figures have changed in a way that people wait for."""
        self._is_changed = True

    async def run(self) -> None:
        """Watch for ever."""
        measuring = asyncio.create_task(self._lag.run(), name="lag")
        try:
            await self._watch()
        finally:
            self._hangs.close()
            measuring.cancel()

    async def _watch(self) -> None:
        loop = asyncio.get_running_loop()
        seen = self._progress()
        figures_due_s = fed_s = loop.time()
        self._hangs.fed()
        while True:
            now_s = loop.time()
            if not self._is_ready and all(self._progress().values()):
                self._become_ready()
            if self._watchdog_every_s is not None and now_s - fed_s >= 2 * self._watchdog_every_s / FEEDS:
                progress = self._progress()
                if all(steps != seen.get(name) for name, steps in progress.items()):
                    self._notifier.watchdog()
                    self._hangs.fed()
                    seen, fed_s = progress, now_s
            for watch in self._lag_watches:
                watch.look(now_s)
            self._look_at_load(now_s)
            if self._is_changed:
                self._is_changed = False
                figures_due_s = min(figures_due_s, now_s + SETTLING_S)
            if now_s >= figures_due_s:
                self._put_figures()
                figures_due_s = now_s + FIGURES_EVERY_S
            await asyncio.sleep(LOOK_S)

    def _become_ready(self) -> None:
        self._is_ready = True
        self._tell_status()
        self._notifier.ready(f"polling {len(self._lines)} line(s)")
        log.info("lines=%s polling", ",".join(line.name for line in self._lines))

    def _tell_status(self) -> None:
        if not self._is_ready:
            return
        troubles = [f"line {line}: {trouble}" for line, trouble in self._port_troubles.items()]
        troubles += [f"starter {name}: {trouble}" for name, trouble in self._starter_troubles.items()]
        troubles += [self._link_trouble] if self._link_trouble else []
        self._publisher.set_status("degraded" if troubles else "online", "; ".join(troubles) or None)
        self._notifier.status("; ".join(troubles) or "polling")

    def _look_at_load(self, now_s: float) -> None:
        """Tell when a line has become too full for what it is asked, and when no longer; watchdogs first."""
        for line in self._lines:
            figures = line.figures()
            self._look_at_watchdogs(line.name, figures, now_s)
            saturation = self._saturations.get(line.name)
            if saturation is None:
                continue
            is_full = saturation.take(figures.get("utilisation", 0.0), now_s)
            if is_full:
                text = f"line {line.name}: no time to spare for {FOR_S:g} s, values come late"
                self._tell("line_saturated", Severity.WARNING, text)
            elif is_full is not None:
                self._tell("line_relieved", Severity.INFO, f"line {line.name}: has time to spare again")

    def _look_at_watchdogs(self, line: str, figures: Mapping[str, Any], now_s: float) -> None:
        """Tell of starters whose watchdogs this line does not keep, those found in the starters included."""
        if "watchdogs" not in figures:
            return
        text = self._watchdog_alarms.setdefault(line, WatchdogAlarm()).take(figures["watchdogs"], now_s)
        if text is not None:
            self._tell("watchdog_unkept", Severity.ERROR, f"line {line}: {text}")

    def _put_figures(self) -> None:
        lag_s = {"line": round(self._lines_lag.worst_s, 4), "gateway": round(self._lag.worst_s, 4)}
        for line in self._lines:
            self._sink.put(
                LineRecord(line.name, {**line.figures(), **self._computed_of(line), "lag_s": lag_s})
            )

    def _computed_of(self, line: LineClient) -> dict[str, Any]:
        return {"computed": self._computed[line.name]} if line.name in self._computed else {}


class _LagWatch:
    """Tells of one loop's delays: the first that is worth it, then only after a quiet minute again."""

    shortest_watchdog_s: float | None = None

    def __init__(self, what: str, meter: LagMeter, tell: Tell) -> None:
        self._what = what
        self._meter = meter
        self._tell = tell
        self._warning, self._alarm = Alarm(LAG_QUIET_S), Alarm(LAG_QUIET_S)

    def look(self, now_s: float) -> None:
        worst_s = self._meter.take_worst_s()
        text = f"{self._what} was {worst_s:.3f} s late"
        if worst_s > (self.shortest_watchdog_s or float("inf")) / 3 and self._alarm.sounds(now_s):
            self._tell("lag", Severity.ERROR, f"{text}: starters' watchdogs may act")
        if worst_s > LAG_WARNS_S and self._warning.sounds(now_s):
            log.warning("%s; it is said once, the worst is in the line's statistics", text)
