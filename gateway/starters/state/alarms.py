"""The alarm book of one starter: which faults and alarms are active, how often they came, when they went.

It is made of settled values only. An alarm that is over stays in it, since its count goes on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from gateway.contract import Event, EventCode, Severity, event_of
from gateway.families import Alarm


@dataclass(frozen=True, slots=True)
class AlarmStatus:
    """One fault or alarm as it is now."""

    alarm: Alarm
    is_active: bool
    raised_s: float  # UTC, the last time it came
    cleared_s: float | None  # UTC, None while it is active
    count: int  # how often it came

    @property
    def is_fault(self) -> bool:
        """Return whether it trips the motor."""
        return self.alarm.severity == "fault"


AlarmBook = Mapping[str, AlarmStatus]  # by code: all that were active once since the gateway's start


def updated(
    book: AlarmBook, active: Iterable[Alarm], *, time_s: float
) -> tuple[AlarmBook, tuple[AlarmStatus, ...]]:
    """Return the book in which these alarms are active and no others, and the ones that came or went."""
    by_code = {alarm.code: alarm for alarm in active}
    before = {code for code, known in book.items() if known.is_active}
    came = [_raised(each, book.get(code), time_s) for code, each in by_code.items() if code not in before]
    went = [
        replace(known, is_active=False, cleared_s=time_s)
        for code, known in book.items()
        if code in before and code not in by_code
    ]
    changed = (*came, *went)
    return {**book, **{each.alarm.code: each for each in changed}} if changed else book, changed


def active_faults(book: AlarmBook) -> tuple[AlarmStatus, ...]:
    """Return the faults that are active, in the order of their codes."""
    active = (known for known in book.values() if known.is_active and known.is_fault)
    return tuple(sorted(active, key=lambda known: known.alarm.code))


def events_of(changed: Sequence[AlarmStatus]) -> list[Event]:
    """Return the events of alarms that came or went.

    Where one takes the place of another (the number of a fault comes, or changes), that one's end is none.
    """
    came = {known.alarm.severity for known in changed if known.is_active}
    return [_event(known) for known in changed if known.is_active or known.alarm.severity not in came]


def named(alarms: Sequence[AlarmStatus]) -> str:
    """Return some faults, or some alarms, in words: fault E05 Motor overload."""
    titles, kind = ", ".join(known.alarm.title for known in alarms), alarms[0].alarm.severity
    return kind + titles[len(kind) :] if titles.lower().startswith(kind) else f"{kind} {titles}"


def _raised(alarm: Alarm, earlier: AlarmStatus | None, time_s: float) -> AlarmStatus:
    count = 1 if earlier is None else earlier.count + 1
    return AlarmStatus(alarm, is_active=True, raised_s=time_s, cleared_s=None, count=count)


def _event(known: AlarmStatus) -> Event:
    code, kind, count = known.alarm.code, known.alarm.severity, known.count
    if not known.is_active:
        title = known.alarm.title
        return event_of(EventCode.CLEARED, alarm=code, severity_=kind, count=count, title=title)
    severity, title = Severity.ERROR if known.is_fault else Severity.WARNING, named([known])
    return event_of(EventCode.ALARM, severity=severity, alarm=code, severity_=kind, count=count, title=title)
