"""Which request has the line next: jobs by lane, polls by due time, silent units ever less often."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf
from operator import attrgetter

from gateway.line.health import Sign, UnitHealth, UnitState
from gateway.line.job import Job, Lane, Poll
from gateway.line.outcome import Garbled, Outcome
from gateway.modbus.pdu import Request

BACK_OFF_FLOOR_S = 1.0
BACK_OFF_CEILING_S = 16.0
JOBS_IN_ROW = 4  # that an overdue poll lets pass; stops do not count

_BROADCAST = 0


@dataclass(frozen=True, slots=True)
class Turn:
    """One request that the plan has chosen; exactly one of `poll` and `job` is set."""

    unit: int
    request: Request
    response_time_s: float
    since_s: float  # when the poll was due or the job submitted
    poll: Poll | None = None
    job: Job | None = None
    is_repetition: bool = False  # the reply to the first attempt was garbled


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an outcome means beyond its own turn."""

    is_final: bool  # False: the request is repeated, or its poll is gone; nobody is told
    is_answering: bool | None = None  # the unit's new state when that has just changed


@dataclass(slots=True)
class _Entry:
    """One poll and when it is due."""

    poll: Poll
    every_s: float
    order: tuple[float, int]  # due time; then first come, first served
    is_hastened: bool = False  # asked for once more while its request is under way
    is_repetition: bool = False
    is_first: bool = False  # of its unit, and not asked since the port was opened

    @property
    def due_s(self) -> float:
        return self.order[0]


@dataclass(slots=True)
class _Unit:
    """One unit's polls; while it is held only the first of them, the probe, is asked."""

    health: UnitHealth = field(default_factory=UnitHealth)
    entries: list[_Entry] = field(default_factory=list)
    is_held: bool = False
    probes: int = 0  # without an answer since it went silent
    told: bool | None = None  # whether it answers, as last returned by `news`

    def news(self) -> bool | None:
        """Return whether the unit answers when that is not what was told before; None for nothing new."""
        is_answering = {UnitState.ANSWERING: True, UnitState.SILENT: False}.get(self.health.state, self.told)
        if is_answering is self.told:
            return None
        self.told = is_answering
        return is_answering


class Plan:
    """Chooses; has no clock of its own, so every call that needs the time is given it."""

    def __init__(self, polls: Iterable[Poll] = (), *, seed: int = 0, jitter: float = 0.1) -> None:
        self._random = random.Random(seed)
        self._jitter = jitter
        self._serial = 0
        self._entries: dict[str, _Entry] = {}
        self._units: dict[int, _Unit] = {}
        self._waiting: dict[Lane, deque[Turn]] = {lane: deque() for lane in Lane}
        self._jobs_in_row = 0
        for poll in polls:
            self.add_poll(poll, -inf)

    def begin(self, now_s: float) -> None:
        """Begin on an opened port: overdue polls are due now, once; each unit's state is news again."""
        for unit in self._units.values():
            unit.told = None
        for entry in self._entries.values():
            entry.is_first = entry is self._units[entry.poll.unit].entries[0]
            entry.order = (max(entry.due_s, now_s), entry.order[1])

    def add_poll(self, poll: Poll, now_s: float) -> None:
        """Repeat a request from now on; ValueError when its key is taken."""
        if poll.key in self._entries:
            raise ValueError(f"there is a poll {poll.key!r} already")
        unit = self._units.setdefault(poll.unit, _Unit())
        entry = _Entry(poll, poll.every_s, self._order(now_s))
        if unit.is_held and unit.entries:
            entry.order = self._order(inf)
        unit.entries.append(entry)
        self._entries[poll.key] = entry

    def remove_poll(self, key: str) -> None:
        """Ask no more; KeyError when there is no such poll."""
        entry = self._entries.pop(key)
        unit = self._units[entry.poll.unit]
        was_probe = unit.entries[0] is entry
        unit.entries.remove(entry)
        if unit.is_held and was_probe and unit.entries:
            unit.entries[0].order = entry.order

    def set_every(self, key: str, every_s: float, now_s: float) -> None:
        """Change a poll's period; a shorter one takes effect at once. KeyError when there is no such poll."""
        entry = self._entries[key]
        entry.every_s = every_s
        if not self._units[entry.poll.unit].is_held:
            self._bring_forward(entry, now_s + every_s)

    def hasten(self, key: str, now_s: float) -> None:
        """Make a poll due now, or the probe of a unit that does not answer; KeyError as above."""
        entry = self._entries[key]
        unit = self._units[entry.poll.unit]
        if unit.is_held:
            entry = unit.entries[0]
        entry.is_hastened = True
        self._bring_forward(entry, now_s)

    def expect_silence(self, unit: int, until_s: float) -> None:
        """Count no misses of this unit until then; only its probe is asked after a first one."""
        self._units.setdefault(unit, _Unit()).health.expect_silence(until_s)

    def submit(self, job: Job, now_s: float) -> None:
        """Queue a job at the end of its lane."""
        turn = Turn(job.unit, job.request, job.response_time_s, now_s, job=job)
        self._waiting[job.lane].append(turn)

    def withdraw(self, job: Job) -> bool:
        """Take a waiting job back; False when it is not waiting (any more)."""
        lane = self._waiting[job.lane]
        for turn in lane:
            if turn.job is job:
                lane.remove(turn)
                return True
        return False

    def take_jobs(self) -> tuple[Job, ...]:
        """Return all waiting jobs and forget them."""
        turns = [turn for lane in self._waiting.values() for turn in lane]
        for lane in self._waiting.values():
            lane.clear()
        return tuple(turn.job for turn in turns if turn.job is not None)

    def polls(self) -> tuple[Poll, ...]:
        """Return the polls that are asked at present: of a held unit only the probe."""
        return tuple(entry.poll for entry in self._entries.values() if entry.due_s < inf)

    def state_of(self, unit: int) -> UnitState:
        """Return what is known of a unit."""
        return self._units[unit].health.state if unit in self._units else UnitState.NEW

    def next_due_s(self) -> float:
        """Return when there is something to do; infinity when nothing is planned."""
        if any(self._waiting.values()):
            return -inf
        return min((entry.due_s for entry in self._entries.values()), default=inf)

    def pick(self, now_s: float) -> Turn | None:
        """Return what has the line next, None when nothing is due; `record` or `put_back` must follow."""
        if self._waiting[Lane.STOP]:
            return self._waiting[Lane.STOP].popleft()
        entry = min(self._entries.values(), key=attrgetter("order"), default=None)
        if entry is not None and entry.due_s > now_s:
            entry = None
        # A unit's watchdog may be waiting for its first poll: what we ask of our own accord can wait longer.
        last_lane = Lane.COMMAND if entry is not None and entry.is_first else Lane.READ_BACK
        lane = next((jobs for kind, jobs in self._waiting.items() if jobs and kind <= last_lane), None)
        if lane is not None and (entry is None or self._jobs_in_row < JOBS_IN_ROW):
            self._jobs_in_row += 1
            return lane.popleft()
        if entry is None:
            return None
        self._jobs_in_row = 0
        entry.is_hastened = entry.is_first = False
        poll = entry.poll
        is_repetition = entry.is_repetition
        return Turn(
            poll.unit, poll.request, poll.response_time_s, entry.due_s, poll=poll, is_repetition=is_repetition
        )

    def put_back(self, turn: Turn, until_s: float) -> None:
        """Take back a turn whose unit may not be asked yet: a poll lets others pass, a job does not."""
        if turn.job is not None:
            self._waiting[turn.job.lane].appendleft(turn)
        elif (entry := self._entry_of(turn)) is not None:
            entry.order = self._order(until_s)

    def record(self, turn: Turn, outcome: Outcome, now_s: float) -> Verdict:
        """Learn what became of a picked turn and plan on."""
        entry = self._entry_of(turn)
        is_repeated = self._repeat_if_garbled(turn, entry, outcome)
        if entry is not None and not is_repeated:
            self._plan_next(entry, now_s)
        is_final = not is_repeated and (turn.poll is None or entry is not None)
        if turn.unit == _BROADCAST:
            return Verdict(is_final)
        return Verdict(is_final, self._learn(turn, outcome, now_s))

    def _entry_of(self, turn: Turn) -> _Entry | None:
        """Return the entry of a poll's turn, None for a job or a poll that was removed meanwhile."""
        if turn.poll is None:
            return None
        entry = self._entries.get(turn.poll.key)
        return entry if entry is not None and entry.poll is turn.poll else None

    def _repeat_if_garbled(self, turn: Turn, entry: _Entry | None, outcome: Outcome) -> bool:
        """Keep a garbled read due, once; a write is never sent twice on the line's own account."""
        is_repeated = (
            isinstance(outcome, Garbled)
            and outcome.is_sent
            and not turn.is_repetition
            and not turn.request.is_write
        )
        if entry is not None:
            entry.is_repetition = is_repeated
        elif turn.job is not None and is_repeated:
            again = Turn(
                turn.unit, turn.request, turn.response_time_s, turn.since_s, job=turn.job, is_repetition=True
            )
            self._waiting[turn.job.lane].appendleft(again)
        return is_repeated

    def _plan_next(self, entry: _Entry, now_s: float) -> None:
        """Keep the poll's rhythm; where the line is too slow for it, queue again behind the others."""
        due_s = now_s if entry.is_hastened else max(entry.due_s + entry.every_s, now_s)
        entry.order = self._order(due_s)

    def _learn(self, turn: Turn, outcome: Outcome, now_s: float) -> bool | None:
        """Move the unit's health on; return its new state when it began to answer or went silent."""
        unit = self._units.setdefault(turn.unit, _Unit())
        was_silent = unit.health.state is UnitState.SILENT
        sign = unit.health.take(outcome, now_s)
        is_silent = unit.health.state is UnitState.SILENT
        if sign is Sign.ANSWER:
            self._release(unit, turn, now_s)
        elif sign is Sign.MISS and unit.health.is_forgiven(now_s):
            self._hold(unit, now_s + self._pace_s(unit))
        elif is_silent and sign is Sign.MISS and (turn.poll is not None or not was_silent):
            unit.probes += 1
            self._hold(unit, now_s + self._back_off_s(unit))
        return unit.news()

    def _hold(self, unit: _Unit, probe_due_s: float) -> None:
        """Ask only the unit's first poll, and that at its time."""
        unit.is_held = True
        for entry in unit.entries:
            entry.order = self._order(inf)
        if unit.entries:
            unit.entries[0].order = self._order(probe_due_s)

    def _release(self, unit: _Unit, turn: Turn, now_s: float) -> None:
        """Ask everything of a unit that answers again; the poll that was answered keeps its own time."""
        unit.probes = 0
        if not unit.is_held:
            return
        unit.is_held = False
        for entry in unit.entries:
            if entry.poll is not turn.poll:
                self._bring_forward(entry, now_s)

    def _pace_s(self, unit: _Unit) -> float:
        every_s = unit.entries[0].every_s if unit.entries else 0.0
        return max(every_s, BACK_OFF_FLOOR_S)

    def _back_off_s(self, unit: _Unit) -> float:
        base_s = self._pace_s(unit)
        doublings = min(unit.probes, 16)
        delay_s = min(base_s * 2.0**doublings, max(BACK_OFF_CEILING_S, base_s))
        return delay_s * (1.0 + self._jitter * self._random.uniform(-1.0, 1.0))

    def _bring_forward(self, entry: _Entry, due_s: float) -> None:
        if due_s < entry.due_s:
            entry.order = self._order(due_s)

    def _order(self, due_s: float) -> tuple[float, int]:
        self._serial += 1
        return (due_s, self._serial)
