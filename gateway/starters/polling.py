"""Which rows of one starter are asked for again and again, how often, and which are overdue or refused.

1. A block that is refused in `IN_ROW` polls running is asked for row by row, so that its other rows go on. A
   minute later it is asked for as a whole again, unless one of its rows is refused alone.
2. A row that is refused alone in `IN_ROW` polls running is not asked for until an hour later. One that
   decides state, fault or watchdog is asked for all the same, every `REFUSED_EVERY_S`, until a minute after
   it is answered.
3. After a silence everything is asked for again.
4. A value that was not read for `OVERDUE_PERIODS` of its period, as the line stretches it, is stale.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

from gateway.contract import EventCode, phrase
from gateway.families import Profile, Variant, diagnosis, once_per_profile, reading
from gateway.line import FREE_PERIOD_S, LineClient
from gateway.modbus import exception_name
from gateway.starters.setup import StarterSetup, blocks_of

BUSY_STATES = frozenset({"starting", "stopping", "fault"})  # read faster while in one of these
IDLE_STATES = frozenset({"ready", "not_ready"})  # the motor is at rest: values are read more slowly
FAST_S = 0.25  # period while the motor starts, stops or is in fault

OVERDUE_PERIODS = 3
OVERDUE_GRACE_S = 1.0  # with this much patience for a loaded line
UNKNOWN_GAP_S = 3.0  # how long a round may take before one has been seen
GAP_PERIODS = 2  # between two answers at most, as the line stretches them: a longer one had a loss in it

IN_ROW = 2
REFUSED_EVERY_S = 5.0
WHOLE_AFTER_S, AGAIN_AFTER_S = 60.0, 3600.0


@dataclass(slots=True)
class _Polled:
    """One block under way; times on the steady clock."""

    block: reading.Block
    every_s: float
    last_s: float = inf  # of the last answer; inf since the starter was lost, or this is overdue
    gap_s: float = UNKNOWN_GAP_S  # between the last two answers, as far as an over-full line explains it
    stretch: float = 1.0  # of the line's periods at the last answer, by which its next time was planned
    refusals: int = 0  # in a row
    exception: int = 0  # the code of the latest

    @property
    def is_refused(self) -> bool:
        """Return whether it was refused so often in a row that it is not by chance."""
        return self.refusals >= IN_ROW

    def overdue_s(self, stretch: float) -> float:
        """Return when the values of this block are stale unless it is answered before.

        The line stretches periods by `stretch` now. The gap before the last answer may have been a short one:
        what has changed is read again at once.
        """
        factor = max(stretch, self.stretch)
        every_s = self.every_s if factor == 1.0 else (self.every_s or FREE_PERIOD_S)
        return self.last_s + OVERDUE_PERIODS * max(every_s * factor, self.gap_s) + OVERDUE_GRACE_S


class Polling:
    """The polls of one starter; begins with those of `polls_of`, which the line has already."""

    def __init__(self, setup: StarterSetup, line: LineClient) -> None:
        self._setup = setup
        self._line = line
        self._state = ""  # of the starter, by which the pace is chosen
        self._plan = blocks_of(setup, setup.variant)
        self._polled = {setup.key_of(block): _Polled(block, self._every_s(block)) for block in self._plan}
        self.next_overdue_s = inf  # when to look for overdue blocks, at times a little early
        self._vital = vital_codes(setup.profile)
        self._whole_at_s = inf  # when to ask for all blocks as a whole again

    def block(self, key: str) -> reading.Block | None:
        """Return what a poll asks for; None when it is withdrawn."""
        polled = self._polled.get(key)
        return None if polled is None else polled.block

    def note_answer(self, key: str, *, at_s: float) -> None:
        """Record that a poll was answered."""
        polled = self._polled[key]
        stretch = polled.stretch = self._line.stretch
        if polled.last_s < inf:
            slowest_s = GAP_PERIODS * (polled.every_s or FREE_PERIOD_S) * stretch
            polled.gap_s = min(at_s - polled.last_s, slowest_s)
        polled.last_s = at_s
        self.next_overdue_s = min(self.next_overdue_s, polled.overdue_s(stretch))
        if polled.refusals:
            if polled.is_refused:
                self._whole_at_s = at_s + WHOLE_AFTER_S
            polled.refusals = 0
            self._keep_pace()
        if at_s >= self._whole_at_s:
            self.restore()

    def note_refusal(self, key: str, code: int, *, at_s: float) -> tuple[str, ...]:
        """Record that a poll was refused; return the codes of which nothing is known any more."""
        polled = self._polled[key]
        polled.refusals, polled.exception = polled.refusals + 1, code
        if not polled.is_refused:
            return ()
        if len(polled.block.codes) > 1:
            self._whole_at_s = at_s + WHOLE_AFTER_S
            self._withdraw((key,))
            for row in reading.split(polled.block):
                self._add(row, last_s=polled.last_s)
            return ()
        if polled.refusals == IN_ROW:
            self._whole_at_s = at_s + AGAIN_AFTER_S
        if self.is_vital(polled.block) or len(self._polled) == 1:
            self._keep_pace()
        else:
            self._withdraw((key,))
        return polled.block.codes

    def is_vital(self, block: reading.Block) -> bool:
        """Return whether a block has a row that decides state, fault or watchdog."""
        return not self._vital.isdisjoint(block.codes)

    def refusal(self) -> str:
        """Return in words which rows that decide state, fault or watchdog are refused; empty for none."""
        refused = [each for each in self._polled.values() if each.is_refused and self.is_vital(each.block)]
        if not refused:
            return ""
        codes = ", ".join(code for each in refused for code in each.block.codes)
        why = exception_name(refused[0].exception)
        return phrase(EventCode.DEGRADED, "rows_refused", codes=codes, why=why, seconds=REFUSED_EVERY_S)

    def note_silence(self) -> None:
        """Record that the starter is lost: nothing is overdue until it answers again."""
        for polled in self._polled.values():
            polled.last_s, polled.gap_s, polled.refusals = inf, UNKNOWN_GAP_S, 0

    def restore(self) -> None:
        """Ask for the whole plan again, whatever was refused."""
        self._whole_at_s = inf
        wanted = {self._setup.key_of(block): block for block in self._plan}
        others = {key: polled for key, polled in self._polled.items() if wanted.get(key) != polled.block}
        last_s = max((polled.last_s for polled in others.values() if polled.last_s < inf), default=inf)
        self._withdraw(others)
        for block in self._plan:
            self._add(block, last_s=last_s)

    def replan(self, setup: StarterSetup, variant: Variant) -> None:
        """Ask for what a starter of this variant has, as often as this set-up says."""
        self._setup = setup
        self._keep_pace()
        plan = blocks_of(setup, variant)
        if plan != self._plan:
            self._plan = plan
            self.restore()

    def follow(self, state: str) -> None:
        """Ask as often as the starter's state wants it, and at once for what a change of it changes."""
        before, self._state = self._state, state
        if state == before:
            return
        self._keep_pace()
        if state == "starting":
            self.expedite("values")  # the current rises within tenths of a second
        if before == "starting" and state == "running":
            self.expedite("slow")  # how much the start has heated the motor
        if state == "fault":
            self.expedite()  # the fault's number and the values around it, soon

    def expedite(self, group: str = "") -> None:
        """Have everything read now, or the rows of one group."""
        for key, polled in self._polled.items():
            if group in ("", polled.block.group):
                self._line.expedite(key)

    def take_overdue(self, now_s: float) -> tuple[str, ...]:
        """Return the codes that have become overdue, once."""
        codes: list[str] = []
        self.next_overdue_s, stretch = inf, self._line.stretch
        for polled in self._polled.values():
            overdue_s = polled.overdue_s(stretch)
            if overdue_s <= now_s:
                polled.last_s = inf
                codes += polled.block.codes
            else:
                self.next_overdue_s = min(self.next_overdue_s, overdue_s)
        return tuple(codes)

    def _add(self, block: reading.Block, *, last_s: float) -> None:
        """Ask for a block; values of it that were read at `last_s` grow old from then on."""
        key = self._setup.key_of(block)
        if key not in self._polled:
            every_s = self._every_s(block)
            self._polled[key] = _Polled(block, every_s, last_s)
            self._line.add_poll(self._setup.poll_of(block, every_s=every_s))  # the line knows the watchdog

    def _withdraw(self, keys: Iterable[str]) -> None:
        for key in keys:
            del self._polled[key]
            self._line.remove_poll(key)

    def _keep_pace(self) -> None:
        for key, polled in self._polled.items():
            every_s = REFUSED_EVERY_S if polled.is_refused else self._every_s(polled.block)
            if every_s != polled.every_s:
                polled.every_s = every_s
                self.next_overdue_s = -inf
                self._line.set_every(key, every_s)

    def _every_s(self, block: reading.Block) -> float:
        every_s = block.period_s(self._setup.every_s)
        if self._state in BUSY_STATES and block.group in (reading.STATUS, reading.VALUES):
            return min(every_s, FAST_S)
        is_slower = self._state in IDLE_STATES and block.group == reading.VALUES
        return every_s * reading.IDLE_FACTOR if is_slower else every_s


@once_per_profile
def vital_codes(profile: Profile) -> frozenset[str]:
    """Return the rows that decide state, fault or watchdog and that the starter surely has."""
    status = [name for name, point in profile.points.items() if point.group == "status"]
    numbers = ["fault_code"] if "fault_code" in profile.points else []
    codes = (*reading.rows_of_points(profile, status + numbers), *diagnosis.watchdog_codes(profile))
    return frozenset(code for code in codes if profile.parameters[code].is_sure)
