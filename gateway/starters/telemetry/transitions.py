"""What follows from one status after another.

`Settled` takes what two readings in a row say, `Watch` makes events of it: a start, a stop, a fault, a
switch to local operation. A trip is one event, which names its faults. `AlarmBook` has the faults and
alarms: which are active, how often they came, when they went. `PublishedFaults` are the standing faults that
an earlier run has published, so that the next one repeats none and leaves none out. One counts as published
once it has stood for `LASTING_S`: its event is in the outbox on the disk then. What is killed before that
publishes it once more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import TypeAdapter

from gateway.contract import Event, EventCode, Severity, event_of, phrase
from gateway.families import Alarm
from gateway.store import Documents

UNKNOWN = "unknown"
STARTED = frozenset({"starting", "running"})
TURNING = STARTED | {"stopping"}
AT_REST = frozenset({"ready", "not_ready"})


class Settled:
    """Points as two readings one after the other have given them; what is not known now is in neither."""

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}
        self._waiting: dict[str, tuple[Any, float]] = {}  # values that were read once, with their time
        self.is_waiting = False  # some point must be read once more

    def note(self, readings: Mapping[str, tuple[Any, float]]) -> None:
        """Record all points that are known now, each with the time of its reading."""
        for name in self._values.keys() - readings.keys():
            del self._values[name]
        waiting: dict[str, tuple[Any, float]] = {}
        for name, (value, at_s) in readings.items():
            if name in self._values and self._values[name] == value:
                continue
            before = self._waiting.get(name)
            if before is None or not _agree(before[0], value):
                waiting[name] = (value, at_s)
            elif at_s > before[1]:
                self._values[name] = value
            else:
                waiting[name] = before
        self._waiting = waiting
        self.is_waiting = bool(waiting)

    def is_waiting_for(self, names: Iterable[str]) -> bool:
        """Return whether one of these points must be read once more."""
        return not self._waiting.keys().isdisjoint(names)

    def waiting_since_s(self, name: str) -> float | None:
        """Return when a point was first read as what must be read once more; None for nothing."""
        waiting = self._waiting.get(name)
        return None if waiting is None else waiting[1]

    @property
    def values(self) -> Mapping[str, Any]:
        """Return the settled values; a point whose value is about to change keeps the one before."""
        return self._values


def _agree(one: Any, other: Any) -> bool:
    """Return whether two readings say the same of what makes events: starting and running are both on."""
    return bool(one == other) or {str(one), str(other)} <= STARTED


class Watch:
    """Compares each settled status with the last one; a fault that stands at the first look is an event too.

    `is_known` says that an earlier run has published the fault.
    """

    def __init__(self) -> None:
        self._state: str | None = None
        self._first: str | None = None
        self._remote: bool | None = None
        self._started_s: float | None = None

    def begin(self, state: str) -> None:
        """Record the first state of all, read once: a motor that is then found on was started since."""
        self._first = self._first or state

    def note(
        self,
        state: str,
        *,
        remote: bool | None,
        time_s: float,
        is_known: bool = False,
        faults: Sequence[AlarmStatus] = (),
    ) -> tuple[Event, ...]:
        """Record a status read at `time_s` (UTC) and return what happened since the last one.

        `faults` are those that make the state `fault`: its event names them.
        """
        events = [*self._of_remote(remote), *self._of_state(state, time_s, is_known=is_known, faults=faults)]
        self._remote = self._remote if remote is None else remote
        self._state = self._state if state == UNKNOWN else state
        return tuple(events)

    @property
    def is_in_fault(self) -> bool:
        """Return whether the last known state was a fault."""
        return self._state == "fault"

    def _of_state(
        self, state: str, time_s: float, *, is_known: bool, faults: Sequence[AlarmStatus]
    ) -> list[Event]:
        before = self._state
        if before is None and state in STARTED and self._first in AT_REST:
            before = self._first
        if before is None and state == "fault" and not is_known:
            return [
                _trip(faults, phrase(EventCode.FAULT, "found", named=_named(faults)), before=None, to=state)
            ]
        if before is None or state in (before, UNKNOWN):
            return []
        if state == "fault":
            return [_trip(faults, _named(faults), before=before, to=state, run_s=self._duration_s(time_s))]
        if state in STARTED and before not in STARTED:
            self._started_s = time_s
            return [event_of(EventCode.STARTED, from_=before, to=state)]
        if state in AT_REST and before in TURNING:
            run_s = self._duration_s(time_s)
            return [event_of(EventCode.STOPPED, from_=before, to=state, run_s=run_s)]
        return []

    def _duration_s(self, time_s: float) -> float | None:
        """Return how long the motor has been on, once per start that was seen."""
        started_s, self._started_s = self._started_s, None
        return None if started_s is None else round(time_s - started_s, 3)

    def _of_remote(self, remote: bool | None) -> list[Event]:  # noqa: FBT001 - a reading, not an option
        if self._remote is None or remote is None or remote is self._remote:
            return []
        return [event_of(EventCode.REMOTE_OPERATION if remote else EventCode.LOCAL_OPERATION)]


@dataclass(frozen=True, slots=True)
class AlarmStatus:
    """One alarm as it stands."""

    alarm: Alarm
    is_active: bool
    raised_s: float  # UTC, the last time it came
    cleared_s: float | None  # UTC, None while it is active
    count: int  # how often it came


def alarm_event(standing: AlarmStatus) -> Event:
    """Return the event of an alarm, or of a further fault, that came or went."""
    alarm, count = standing.alarm, standing.count
    if not standing.is_active:
        return event_of(
            EventCode.CLEARED, alarm=alarm.code, severity_=alarm.severity, count=count, title=alarm.title
        )
    return event_of(
        EventCode.ALARM,
        severity=Severity.ERROR if alarm.severity == "fault" else Severity.WARNING,
        alarm=alarm.code,
        severity_=alarm.severity,
        count=count,
        title=_named([standing]),
    )


def _named(standings: Sequence[AlarmStatus]) -> str:
    """Return faults, or an alarm, in words: fault E05 Motor overload."""
    if not standings:
        return phrase(EventCode.FAULT, "unnumbered")
    titles, kind = ", ".join(standing.alarm.title for standing in standings), standings[0].alarm.severity
    return kind + titles[len(kind) :] if titles.lower().startswith(kind) else f"{kind} {titles}"


def _trip(
    faults: Sequence[AlarmStatus], named: str, *, before: str | None, to: str, run_s: float | None = None
) -> Event:
    """Return the event of a trip with all its faults, the first one also as in an alarm's event."""
    return event_of(
        EventCode.FAULT,
        from_=before,
        to=to,
        run_s=run_s,
        alarm=faults[0].alarm.code if faults else None,
        severity_="fault" if faults else None,
        faults=[{"code": each.alarm.code, "text": each.alarm.text, "count": each.count} for each in faults],
        named=named,
    )


class AlarmBook:
    """Remembers every alarm that was active once since the gateway's start."""

    def __init__(self) -> None:
        self._standings: dict[str, AlarmStatus] = {}

    def update(self, active: Iterable[Alarm], *, time_s: float) -> tuple[AlarmStatus, ...]:
        """Record which alarms are active now, and return those that came or went."""
        by_code = {alarm.code: alarm for alarm in active}
        changed = [
            self._raise(alarm, time_s) for alarm in by_code.values() if not self._is_active(alarm.code)
        ]
        changed += [
            self._clear(standing, time_s)
            for standing in self._standings.values()
            if standing.is_active and standing.alarm.code not in by_code
        ]
        return tuple(changed)

    def active(self, severity: str) -> tuple[AlarmStatus, ...]:
        """Return those of this severity that are active, in the order of their codes."""
        standings = (each for each in self._standings.values() if each.is_active)
        chosen = (each for each in standings if each.alarm.severity == severity)
        return tuple(sorted(chosen, key=lambda each: each.alarm.code))

    def _is_active(self, code: str) -> bool:
        standing = self._standings.get(code)
        return standing is not None and standing.is_active

    def _raise(self, alarm: Alarm, time_s: float) -> AlarmStatus:
        earlier = self._standings.get(alarm.code)
        count = 1 if earlier is None else earlier.count + 1
        standing = AlarmStatus(alarm, is_active=True, raised_s=time_s, cleared_s=None, count=count)
        self._standings[alarm.code] = standing
        return standing

    def _clear(self, standing: AlarmStatus, time_s: float) -> AlarmStatus:
        cleared = replace(standing, is_active=False, cleared_s=time_s)
        self._standings[standing.alarm.code] = cleared
        return cleared


FAULTS = TypeAdapter(dict[str, tuple[str, ...]])  # codes by starter
LASTING_S = 5.0


class PublishedFaults:
    """The standing faults of all starters, also those that an earlier run has published."""

    def __init__(self, documents: Documents | None = None) -> None:
        self._document = (documents or Documents()).open("faults", FAULTS, lambda: self._codes)
        self._codes = self._document.loaded or {}

    def has(self, starter: str, codes: tuple[str, ...]) -> bool:
        """Return whether an earlier run has published the fault that these alarm codes name."""
        return bool(codes) and self._codes.get(starter) == codes

    def note(self, starter: str, codes: tuple[str, ...]) -> None:
        """Record the fault that stands and was published; none when there is no fault."""
        if self._codes.get(starter, ()) == codes:
            return
        if codes:
            self._codes[starter] = codes
        else:
            del self._codes[starter]
        self._document.touch()
