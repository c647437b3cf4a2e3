"""One starter as a state, and the one function that advances it: `advance`.

1. The newest reading of each point counts for what is shown at once: the word for its state, its booleans.
2. Two readings in a row that agree make events (`settled`), dated by the first of them. A motor that starts
   or stops, local and remote operation, an alarm that comes or goes: all follow from settled values.
3. A trip is one event, which names its faults. It waits for its number, read since the fault was seen, at
   the latest until `NUMBER_WITHIN_S` after the fault was read first. It is published even if the fault is
   over by then, or the starter is lost. A fault keeps its number until it has another one or is over.
4. While a point that decides is not known, nothing is said: neither that an alarm came nor that it went.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

from gateway.contract import Event, EventCode, Quality, event_of, phrase
from gateway.contract import StarterState as Word
from gateway.families import Alarm, Profile, device_of, once_per_profile, state_of
from gateway.starters.state.alarms import AlarmBook, AlarmStatus, active_faults, events_of, named, updated
from gateway.starters.state.decoding import flags_of, unread_points
from gateway.starters.state.readings import NO_POINTS, Moment, Points, Reading, Value, good_values
from gateway.starters.state.settled import STARTED, EarlierPoints, FirstSeen, Settled, settle

UNKNOWN: Word = "unknown"
TURNING = STARTED | {"stopping"}
AT_REST = frozenset({"ready", "not_ready"})

SETS_BEFORE = 3  # sets of values that an event carries from before it
NUMBER_WITHIN_S = 2.0  # of a fault's first reading; then its event is published without its number
FAULT, FAULT_CODE, REMOTE = "fault", "fault_code", "remote"
STATE = "state"  # among what settles; no point has this name


class Status(NamedTuple):
    """What a starter shows now, by its newest readings."""

    word: Word = "unknown"
    quality: Quality = Quality.BAD
    flags: Mapping[str, bool | None] = {}  # its boolean points; None: not known
    number: int | None = None  # of the present fault


@dataclass(frozen=True, slots=True)
class StarterTrip:
    """A fault that is there."""

    first: FirstSeen
    is_sure: bool = False  # two readings have shown it
    is_published: bool = False
    number: int | None = None  # as settled since it was seen first


@dataclass(frozen=True, slots=True)
class Motion:
    """The settled states, one after the other, as far as the next event needs them."""

    state: str | None = None  # the last one that is known
    first: str | None = None  # the first of all, read once: a motor that is found on after it was started
    remote: bool | None = None
    started_s: float | None = None  # UTC, while the motor is on


class StarterState(NamedTuple):
    """All that is known of a starter; `points` is another object once a point says something else."""

    points: Points
    times: Mapping[str, Moment] = {}  # when each was read last; one that never was is absent
    newest_s: float = -inf  # of these times, on the steady clock
    known_faults: tuple[str, ...] = ()  # codes of the fault that an earlier run has published
    status: Status = Status()
    settled: Settled = Settled()
    earlier: tuple[EarlierPoints, ...] = ()
    trip: StarterTrip | None = None
    motion: Motion = Motion()
    alarms: AlarmBook = {}  # noqa: RUF012 - never changed

    def fresh(self, points: Points, at_s: float) -> Points:
        """Return those of a reply's points that were not read later: a command's is handled after polls'."""
        times = self.times
        return {name: new for name, new in points.items() if name not in times or times[name].at_s <= at_s}

    def is_awaiting(self, points: Points) -> bool:
        """Return whether a change gets its second reading by these points, or a trip needs its number."""
        trip, waiting = self.trip, self.settled.waiting
        is_open = trip is not None and (not trip.is_published or trip.number is None)
        return is_open or STATE in waiting or not waiting.keys().isdisjoint(points)

    @property
    def due_s(self) -> float:
        """Return when to look again if nothing is read until then: a trip is published by then."""
        is_open = self.trip is not None and self.trip.is_sure and not self.trip.is_published
        return self.trip.first.at_s + NUMBER_WITHIN_S if self.trip is not None and is_open else inf

    @property
    def published_faults(self) -> tuple[str, ...] | None:
        """Return the codes of the standing fault whose event was published; None while that is open."""
        if self.status.word == UNKNOWN or (self.trip is not None and not self.trip.is_published):
            return None
        return tuple(known.alarm.code for known in active_faults(self.alarms)) if self.trip else ()


def unread(profile: Profile, known_faults: tuple[str, ...] = ()) -> StarterState:
    """Return the state of a starter before its first reply: every point is bad."""
    status = Status(flags=dict.fromkeys(flags_of(profile)))
    return StarterState(unread_points(profile), known_faults=known_faults, status=status)


class NewReadings(NamedTuple):
    """The readings that are new at one moment; without any, only time has passed."""

    now_s: float  # steady clock
    read: Moment  # when the newest of them left the wire; without one, now
    points: Points = NO_POINTS  # what a reply says
    doubts: Points = NO_POINTS  # of points without a new reply: stale or bad ones


class Happening(NamedTuple):
    """An event with its time; `first` where the values before its first reading belong to it."""

    event: Event
    time_s: float  # UTC
    first: FirstSeen | None = None


Happenings = tuple[AlarmStatus | Happening, ...]  # an alarm that came or went, and events


def advance(before: StarterState, news: NewReadings, profile: Profile) -> tuple[StarterState, Happenings]:
    """Return the state after news, and what has happened. Without news that decides this costs little."""
    points, times, newest_s, earlier = news.points, before.times, before.newest_s, before.earlier
    if points:
        times = {**times, **dict.fromkeys(points, news.read)}
        newest_s = max(newest_s, news.read.at_s)
        status = points.get(FAULT)
        if status is not None and status.quality is Quality.GOOD:
            earlier = (*earlier[1 - SETS_BEFORE :], EarlierPoints(news.read.at_s, before.points))
    merged, is_decisive = _merged(before.points, {**news.doubts, **points} if news.doubts else points)
    after = before._replace(points=merged, times=times, newest_s=newest_s, earlier=earlier)
    return _judged(after, news, profile) if is_decisive or before.is_awaiting(points) else (after, ())


def _merged(before: Points, new: Points) -> tuple[Points, bool]:
    """Return all points with the new readings, and whether more than a quantity says something else."""
    other: dict[str, Reading] = {}
    is_decisive = False
    for name, reading in new.items():
        old, value = before[name], reading.value
        is_same = old.value == value and type(old.value) is type(value)  # 1 and true are not
        if is_same and reading == old:
            continue
        other[name] = reading
        if old.quality is not reading.quality or not (is_same or isinstance(value, float)):
            is_decisive = True
    return ({**before, **other} if other else before), is_decisive


def _judged(state: StarterState, news: NewReadings, profile: Profile) -> tuple[StarterState, Happenings]:
    """Return the state after a look at all points, and what has happened."""
    good = good_values(state.points)
    word = state_of(profile, good)
    before = state.settled.values
    settled, new = settle(state.settled, _seen(state, good, word, news, profile))
    oldest = min(new.values(), key=lambda first: first.utc_s, default=None)
    time_s = news.read.time_s if oldest is None else oldest.utc_s
    trip = _followed(state, good, settled, news)
    is_over = trip is not None and trip.is_sure and settled.values.get(FAULT) is False
    motion, events = _remote(state.motion, settled, new, time_s)
    motion = replace(motion, first=motion.first or (None if word == UNKNOWN else word))
    book, changed = state.alarms, list[AlarmStatus]()
    if trip is not None and _is_due(trip, state.points, news, is_over=is_over):
        # The faults are raised with the event that names them, also those of a fault that is over by now.
        trip = replace(trip, is_published=True)
        shown = {**before, FAULT: True} if is_over else settled.values
        book, came = _booked(book, shown, trip, profile, time_s=trip.first.utc_s)
        changed += came
        motion, tripped = _tripped(motion, active_faults(book), state.known_faults, trip.first)
        events += tripped
        events += [
            Happening(event, time_s) for event in events_of([each for each in came if not each.is_fault])
        ]
    trip = None if is_over else trip
    if settled.waiting.keys().isdisjoint(profile.alarm_points):  # else it is open which alarms there are
        book, more = _booked(book, settled.values, trip, profile, time_s=time_s)
        changed += more
        events += [Happening(event, time_s) for event in events_of(more)]
    if trip is None:  # else the next move follows the end of the fault
        motion, moves = _moved(motion, settled, new.get(STATE), time_s)
        events += moves
    status = _status(state, good, word, profile, trip)
    after = state._replace(
        status=state.status if status == state.status else status,  # that one is held by what was published
        settled=settled,
        trip=trip,
        motion=motion,
        alarms=book,
    )
    return after, (*changed, *events)


def _seen(
    state: StarterState, good: Mapping[str, Value], word: Word, news: NewReadings, profile: Profile
) -> dict[str, FirstSeen]:
    """Return what may settle: the booleans, the numbers of alarms, and the word of one reading as a whole."""
    flags = flags_of(profile)
    seen = {
        name: FirstSeen(good[name], state.times[name].at_s, news.now_s, news.read.time_s, state.earlier)
        for name in (*flags, *profile.alarm_points)
        if name in good
    }
    if word != UNKNOWN:  # flags that settle one by one may never have been there together
        at_s = min([seen[name].at_s for name in flags if name in seen])
        seen[STATE] = FirstSeen(word, at_s, news.now_s, news.read.time_s, state.earlier)
    return seen


def _status(
    state: StarterState, good: Mapping[str, Value], word: Word, profile: Profile, trip: StarterTrip | None
) -> Status:
    """Return what is shown now."""
    flags = flags_of(profile)
    quality = Quality.GOOD
    if word == UNKNOWN:
        is_lost = any(state.points[name].quality is Quality.STALE for name in flags)
        quality = Quality.STALE if is_lost else Quality.BAD
    number = (
        good.get(FAULT_CODE) if trip is not None and _is_since(state.times.get(FAULT_CODE), trip) else None
    )
    shown = number if good.get(FAULT) and isinstance(number, int) else None
    seen = ((name, good.get(name)) for name in flags)
    known = {name: value if isinstance(value, bool) else None for name, value in seen}
    return Status(word, quality, known, shown or None)


def _is_since(number: Moment | None, trip: StarterTrip) -> bool:
    """Return whether a number was read since the fault was: P014 of an SSW-07 is that of the last fault."""
    return number is not None and number.at_s >= trip.first.at_s


def _followed(
    state: StarterState, good: Mapping[str, Value], settled: Settled, news: NewReadings
) -> StarterTrip | None:
    """Return the trip as the newest readings show it; a fault that only one reading has shown was none."""
    trip, fault = state.trip, good.get(FAULT)
    if trip is None:
        if not fault:
            return None
        at_s = state.times[FAULT].at_s
        return StarterTrip(FirstSeen(fault, at_s, news.now_s, news.read.time_s, state.earlier))
    if not trip.is_sure and fault is False:
        return None
    number = settled.values.get(FAULT_CODE)
    if FAULT_CODE not in settled.waiting and _is_since(state.times.get(FAULT_CODE), trip):
        trip = replace(trip, number=number if isinstance(number, int) and number else trip.number)
    return replace(trip, is_sure=trip.is_sure or settled.values.get(FAULT) is True)


def _is_due(trip: StarterTrip, points: Points, news: NewReadings, *, is_over: bool) -> bool:
    """Return whether the event of a trip is to be published now."""
    if trip.is_published or not trip.is_sure:
        return False
    is_complete = trip.number is not None or FAULT_CODE not in points
    return is_complete or is_over or news.now_s - trip.first.at_s >= NUMBER_WITHIN_S


def _booked(
    book: AlarmBook,
    settled: Mapping[str, Value],
    trip: StarterTrip | None,
    profile: Profile,
    *,
    time_s: float,
) -> tuple[AlarmBook, Sequence[AlarmStatus]]:
    """Return the alarm book after these settled values; nothing is in it of a fault whose event waits."""
    if any(name not in settled for name in _summary_flags(profile)):
        return book, ()
    shown = settled if trip is None else {**settled, FAULT_CODE: trip.number}
    active: list[Alarm] = device_of(profile).alarms(profile, shown)
    if trip is not None and not trip.is_published:
        active = [alarm for alarm in active if alarm.severity != "fault"]
    return updated(book, active, time_s=time_s)


@once_per_profile
def _summary_flags(profile: Profile) -> tuple[str, ...]:
    """Return the points that say whether there is a fault or an alarm at all."""
    return tuple(name for name in (FAULT, "alarm") if name in profile.points)


def _tripped(
    motion: Motion, faults: Sequence[AlarmStatus], known: tuple[str, ...], first: FirstSeen
) -> tuple[Motion, list[Happening]]:
    """Return the event of a trip with all its faults; none where an earlier run has published them."""
    after = replace(motion, state=FAULT, started_s=None)
    codes = tuple(each.alarm.code for each in faults)
    if motion.state is None and codes and codes == known:
        return after, []
    words = named(faults) if faults else phrase(EventCode.FAULT, "unnumbered")
    event = event_of(
        EventCode.FAULT,
        from_=motion.state,
        to=FAULT,
        run_s=_run_s(motion, first.utc_s),
        alarm=codes[0] if codes else None,
        severity_="fault" if codes else None,
        faults=[{"code": each.alarm.code, "text": each.alarm.text, "count": each.count} for each in faults],
        named=phrase(EventCode.FAULT, "found", named=words) if motion.state is None else words,
    )
    return after, [Happening(event, first.utc_s, first)]


def _moved(
    motion: Motion, settled: Settled, first: FirstSeen | None, time_s: float
) -> tuple[Motion, list[Happening]]:
    """Return the start or stop that brought the motor into its settled state, read first as `first`."""
    now = settled.values.get(STATE)
    if now is None or STATE in settled.waiting or now == motion.state:
        return motion, []
    before, state, after = motion.state, str(now), replace(motion, state=str(now))
    time_s = time_s if first is None else first.utc_s
    if before is None and state in STARTED and motion.first in AT_REST:
        before = motion.first
    if before is None:
        return after, []
    if state in STARTED and before not in STARTED:
        event = event_of(EventCode.STARTED, from_=before, to=state)
        return replace(after, started_s=time_s), [Happening(event, time_s, first)]
    if state in AT_REST and before in TURNING:
        event = event_of(EventCode.STOPPED, from_=before, to=state, run_s=_run_s(motion, time_s))
        return replace(after, started_s=None), [Happening(event, time_s, first)]
    return after, []


def _run_s(motion: Motion, time_s: float) -> float | None:
    """Return how long the motor has been on; None where its start was not seen."""
    return None if motion.started_s is None else round(time_s - motion.started_s, 3)


def _remote(
    motion: Motion, settled: Settled, new: Mapping[str, FirstSeen], time_s: float
) -> tuple[Motion, list[Happening]]:
    """Return a change between local and remote operation."""
    now = settled.values.get(REMOTE)
    if not isinstance(now, bool) or now is motion.remote:
        return motion, []
    after = replace(motion, remote=now)
    if motion.remote is None:
        return after, []
    event = event_of(EventCode.REMOTE_OPERATION if now else EventCode.LOCAL_OPERATION)
    first = new.get(REMOTE)
    return after, [Happening(event, time_s if first is None else first.utc_s, first)]
