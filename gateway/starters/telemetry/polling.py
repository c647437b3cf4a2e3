"""Which rows of one starter are asked for again and again, how often, which are overdue, and what is lost.

A poor line is not a lost starter, and a single refusal proves nothing:

1. A block that is refused three times in a row is asked for row by row, and once every row was answered as a
   whole again.
2. A row that decides state, fault or watchdog is never given up: it is asked again ever less often, at the
   latest every `LONGEST_PAUSE_S`.
3. Any other row is given up after `ENOUGH` refusals at least `APART_S` apart, and tried again after
   `AGAIN_AFTER_S`, and after each silence.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf

from gateway.contract import EventCode, phrase
from gateway.families import Profile, Variant, diagnosis, once_per_profile, reading
from gateway.line import FREE_PERIOD_S, LineClient
from gateway.starters.setup import StarterSetup, blocks_of
from gateway.system.rate_limits import backoff_s

BUSY_STATES = frozenset({"starting", "stopping", "fault"})  # read faster while in one of these
IDLE_STATES = frozenset({"ready", "not_ready"})  # the motor stands: values read more slowly
FAST_S = 0.25  # period while the motor starts, stops or is in fault
IDLE_FACTOR = 3  # values are read so many times less often while it stands, the status is not
OVERDUE_PERIODS = 3  # a value that was not read for so many periods, as the line stretches them, is stale,
UNKNOWN_GAP_S = 3.0  # how long a round may take before one has been seen
OVERDUE_GRACE_S = 1.0  # with this much patience for a loaded line
GAP_PERIODS = 2  # between two answers at most, as the line stretches them: what is longer was lost

IN_ROW = 3  # refusals of a block, before it is asked for row by row; of a row, before it counts as refused
ENOUGH = 3  # refusals of a row
APART_S = 10.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 5.0
AGAIN_AFTER_S = 3600.0
REJOINED_AFTER_S = 15.0  # after the first split of a block; four times as long after each further one


@dataclass(slots=True)
class Refusals:
    """The refusals of one request since it was answered last."""

    in_row: int = 0
    apart: int = 0
    _counted_s: float = -inf

    def note(self, now_s: float) -> None:
        """Count a refusal."""
        self.in_row += 1
        if now_s - self._counted_s >= APART_S:
            self.apart, self._counted_s = self.apart + 1, now_s

    def clear(self) -> None:
        """Count anew: it was answered."""
        self.in_row, self.apart, self._counted_s = 0, 0, -inf

    @property
    def pause_s(self) -> float:
        """Return how long to wait at least before it is asked again; 0 when it is not refused."""
        if not self.in_row:
            return 0.0
        return backoff_s(FIRST_PAUSE_S, LONGEST_PAUSE_S, self.in_row - 1)


@dataclass(slots=True)
class Splits:
    """How often a block was asked for row by row, and when last."""

    count: int = 0
    since_s: float = -inf

    def note(self, now_s: float) -> None:
        """Count a split."""
        self.count, self.since_s = self.count + 1, now_s

    def is_over(self, now_s: float) -> bool:
        """Return whether the block may be asked for as a whole again."""
        pause_s = backoff_s(REJOINED_AFTER_S, AGAIN_AFTER_S, self.count - 1, factor=4.0)
        return now_s - self.since_s >= pause_s


@dataclass(slots=True)
class _Polled:
    """One block under way; times on the steady clock."""

    block: reading.Block
    every_s: float
    last_s: float | None = None  # of the last answer; None since the starter was lost
    gap_s: float | None = None  # between the last two answers, as far as an over-full line explains it
    stretch: float = 1.0  # of the line's periods at the last answer, by which its next time was planned
    is_overdue: bool = False
    refusals: Refusals = field(default_factory=Refusals)
    whole: reading.Block | None = None  # of which this is one row, since it was refused

    @property
    def is_refused(self) -> bool:
        """Return whether it was refused so often in a row that it is not by chance."""
        return self.refusals.in_row >= IN_ROW

    def period_s(self, stretch: float) -> float:
        """Return how long two answers are apart at most, where the line stretches periods by this much.

        The gap before the last answer may have been a short one: what has changed is read again at once.
        """
        factor = max(stretch, self.stretch)
        every_s = self.every_s if factor == 1.0 else (self.every_s or FREE_PERIOD_S)
        return max(every_s * factor, self.gap_s or 0.0)

    def overdue_s(self, stretch: float) -> float:
        """Return when the values of this block are stale unless it is answered before."""
        if self.last_s is None or self.is_overdue:
            return inf
        gap_s = UNKNOWN_GAP_S if self.gap_s is None else 0.0
        return self.last_s + OVERDUE_PERIODS * max(self.period_s(stretch), gap_s) + OVERDUE_GRACE_S

    def forget(self) -> None:
        """Be as if it had never been answered."""
        self.last_s, self.gap_s, self.is_overdue = None, None, False
        self.refusals.clear()


class Polling:
    """The polls of one starter; begins with those of `polls_of`, which the line has already."""

    def __init__(self, setup: StarterSetup, line: LineClient) -> None:
        self._setup = setup
        self._line = line
        self._is_fast = self._is_idle = False
        self._plan = blocks_of(setup)
        self.is_withdrawn = not setup.is_enabled  # nothing is asked, whatever comes
        self._polled = {setup.key_of(block): self._begin(block) for block in self._plan}
        self._soonest_overdue_s = inf  # nothing becomes overdue before
        self._vital = vital_codes(setup.profile)
        self._splits: dict[str, Splits] = {}  # by block
        self._given_up_s: float | None = None  # when a row was given up last; None when all are asked for

    def block(self, key: str) -> reading.Block | None:
        """Return what a poll asks for; None when it is no longer ours."""
        polled = self._polled.get(key)
        return None if polled is None else polled.block

    def note_answer(self, key: str, *, at_s: float) -> None:
        """Record that a poll was answered."""
        polled = self._polled[key]
        stretch = polled.stretch = self._line.stretch
        if polled.last_s is not None:
            slowest_s = GAP_PERIODS * (polled.every_s or FREE_PERIOD_S) * stretch
            polled.gap_s = min(at_s - polled.last_s, slowest_s)
        polled.last_s, polled.is_overdue = at_s, False
        self._soonest_overdue_s = min(self._soonest_overdue_s, polled.overdue_s(stretch))
        if polled.refusals.in_row:
            polled.refusals.clear()
            self._keep_pace()
        if polled.whole is not None:
            self._rejoin(polled.whole, at_s)
        self._try_given_up(at_s)

    def note_refusal(self, key: str, *, at_s: float) -> tuple[str, ...]:
        """Record that a poll was refused; return the codes of which nothing is known any more."""
        polled = self._polled[key]
        polled.refusals.note(at_s)
        if not polled.is_refused:
            self._line.expedite(key)
            return ()
        if len(polled.block.codes) > 1:
            self._split(key, at_s)
            return ()
        is_vital = not self._vital.isdisjoint(polled.block.codes)
        if is_vital or polled.refusals.apart < ENOUGH or len(self._polled) == 1:
            self._keep_pace()
        else:
            self._given_up_s = at_s
            del self._polled[key]
            self._line.remove_poll(key)
        return polled.block.codes

    def refused_vital(self) -> tuple[str, ...]:
        """Return the rows that decide state, fault or watchdog and are refused alone."""
        return tuple(
            code
            for polled in self._polled.values()
            if polled.is_refused and len(polled.block.rows) == 1
            for code in polled.block.codes
            if code in self._vital
        )

    def _split(self, key: str, now_s: float) -> None:
        """Ask row by row for a block that is refused."""
        block = self._polled.pop(key).block
        self._line.remove_poll(key)
        self._splits.setdefault(block.name, Splits()).note(now_s)
        for single in reading.split(block):
            self._add(single, whole=block)

    def _rejoin(self, whole: reading.Block, now_s: float) -> None:
        """Ask for a block as a whole again once each of its rows was answered alone."""
        parts = {key: polled for key, polled in self._polled.items() if polled.whole is whole}
        codes = {code for polled in parts.values() for code in polled.block.codes}
        is_answered = all(p.last_s is not None and not p.refusals.in_row for p in parts.values())
        if not is_answered or codes != set(whole.codes) or not self._splits[whole.name].is_over(now_s):
            return
        last_s = min(polled.last_s for polled in parts.values() if polled.last_s is not None)
        for key in parts:
            del self._polled[key]
            self._line.remove_poll(key)
        self._add(whole)
        self._polled[self._setup.key_of(whole)].last_s = last_s
        self._soonest_overdue_s = -inf

    def _try_given_up(self, now_s: float) -> None:
        """Ask again for everything that was given up, an hour after the last of it."""
        if self._given_up_s is not None and now_s - self._given_up_s >= AGAIN_AFTER_S:
            self.restore()

    def note_silence(self) -> None:
        """Record that the starter is lost: nothing is overdue until it answers again."""
        for polled in self._polled.values():
            polled.forget()

    def set_every(self, every_s: float) -> None:
        """Apply another period for the status and the electrical values."""
        self._setup = replace(self._setup, every_s=every_s)
        self._keep_pace()

    def withdraw(self) -> None:
        """Ask for nothing any more."""
        self.is_withdrawn = True
        for key in self._polled:
            self._line.remove_poll(key)
        self._polled.clear()

    def restore(self) -> None:
        """Ask for everything again that had been given up."""
        self._given_up_s = None
        self._replace(self._plan)

    def replan(self, variant: Variant) -> None:
        """Ask for what a starter of this variant has."""
        plan = reading.plan_blocks(self._setup.profile, variant, timing=self._setup.timing)
        if plan != self._plan:
            self._plan = plan
            self._replace(plan)

    def follow(self, state: str, *, before: str) -> None:
        """Ask as often as the starter's state wants it, and at once for what a change of it changes."""
        pace = state in BUSY_STATES, state in IDLE_STATES
        if pace != (self._is_fast, self._is_idle):
            self._is_fast, self._is_idle = pace
            self._keep_pace()
        if state == "starting" and before != state:
            self.expedite_group("values")  # the current rises within tenths of a second
        if before == "starting" and state == "running":
            self.expedite_group("slow")  # how much the start has heated the motor
        if state == "fault" and before != state:
            self.expedite()  # the fault's number and the values around it, soon

    def _keep_pace(self) -> None:
        for key, polled in self._polled.items():
            every_s = max(self._every_s(polled.block), polled.refusals.pause_s)
            if every_s != polled.every_s:
                polled.every_s = every_s
                self._soonest_overdue_s = -inf
                self._line.set_every(key, every_s)

    def expedite(self) -> None:
        """Have everything read now."""
        for key in self._polled:
            self._line.expedite(key)

    def expedite_group(self, group: str) -> None:
        """Have the rows of one group read now."""
        for key, polled in self._polled.items():
            if polled.block.group == group:
                self._line.expedite(key)

    def take_overdue(self, now_s: float) -> tuple[str, ...]:
        """Return the codes that have become overdue, once."""
        if now_s < self._soonest_overdue_s:
            return ()
        codes: list[str] = []
        self._soonest_overdue_s, stretch = inf, self._line.stretch
        for polled in self._polled.values():
            overdue_s = polled.overdue_s(stretch)
            if overdue_s <= now_s:
                polled.is_overdue = True
                codes += polled.block.codes
            else:
                self._soonest_overdue_s = min(self._soonest_overdue_s, overdue_s)
        return tuple(codes)

    def next_overdue_s(self) -> float:
        """Return when to look for overdue blocks again, at times a little early; infinite for never."""
        return self._soonest_overdue_s

    @property
    def status_period_s(self) -> float:
        """Return the longest time that passes between two readings of the status, as far as it is known."""
        stretch = self._line.stretch
        periods = [p.period_s(stretch) for p in self._polled.values() if p.block.group == "status"]
        return max(periods, default=self._setup.every_s)

    @property
    def patience_s(self) -> float:
        """Return the age up to which a row of the status is still current."""
        return OVERDUE_PERIODS * self.status_period_s + OVERDUE_GRACE_S

    def _begin(self, block: reading.Block) -> _Polled:
        return _Polled(block, self._every_s(block))

    def _add(self, block: reading.Block, *, whole: reading.Block | None = None) -> None:
        key = self._setup.key_of(block)
        if key not in self._polled:
            self._polled[key] = self._begin(block)
            self._polled[key].whole = whole
            poll = self._setup.poll_of(block, every_s=self._polled[key].every_s)
            self._line.add_poll(replace(poll, deadline_s=None))  # the line has it, and may have a newer one

    def _replace(self, plan: tuple[reading.Block, ...]) -> None:
        wanted = {self._setup.key_of(block): block for block in plan}
        for key in [key for key, polled in self._polled.items() if wanted.get(key) != polled.block]:
            del self._polled[key]
            self._line.remove_poll(key)
        for block in plan:
            self._add(block)

    def _every_s(self, block: reading.Block) -> float:
        every_s = self._setup.period_of(block)
        if self._is_fast and block.group != "slow":
            return min(every_s, FAST_S)
        return every_s * IDLE_FACTOR if self._is_idle and block.group == "values" else every_s


@once_per_profile
def vital_codes(profile: Profile) -> frozenset[str]:
    """Return the rows that decide state, fault or watchdog and that the starter surely has."""
    status = (name for name, point in profile.points.items() if point.group == "status")
    codes = (
        *reading.rows_of_points(profile, (*status, *_numbers(profile))),
        *diagnosis.watchdog_codes(profile),
    )
    return frozenset(code for code in codes if profile.parameters[code].is_sure)


def _numbers(profile: Profile) -> tuple[str, ...]:
    return ("fault_code",) if "fault_code" in profile.points else ()


OF = 200  # polls are looked at
_ALL = (1 << OF) - 1
POOR, GOOD_AGAIN = 8, 3  # of them lost: from 4 % on it is said, until it is 1.5 % or less


class PollLoss:
    """Counts the lost polls of one starter among its latest."""

    def __init__(self) -> None:
        self._latest = 0  # a bit for each, 1 for a lost one; the latest is the lowest
        self._count = self._lost = 0
        self._is_poor = False

    def note(self, *, is_lost: bool) -> str | None:
        """Count a poll; return what is wrong, "" once nothing is any more, None for no news."""
        self._lost += is_lost - (self._latest >> (OF - 1))
        self._latest = (self._latest << 1 | is_lost) & _ALL
        self._count = min(self._count + 1, OF)
        was_poor = self._is_poor
        self._is_poor = self._lost >= POOR or (was_poor and self._lost > GOOD_AGAIN)
        if self._is_poor is was_poor:
            return None
        if not self._is_poor:
            return ""
        return phrase(EventCode.DEGRADED, "polls_lost", lost=self._lost, count=self._count)

    def clear(self) -> None:
        """Count anew: the starter itself was lost."""
        self._latest = self._count = self._lost = 0
        self._is_poor = False
