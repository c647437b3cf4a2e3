"""Words about a line's cable, from the counters of its statistics; pure.

Every half minute the replies of each starter are counted that were missing lately: corrupted ones (octets
that are no frame), lost ones (nothing came), late ones. Lately is five to ten minutes, or more until there
are enough requests. A share is bad once its 99 % Wilson interval lies above 2 %, until it lies below. Words
appear and go when four findings in a row agree.

Rules, the starters in the order in which the cable passes them
 1. Two or more that do not answer at all, at the end of a line whose others answer: the cable before them.
    Any other one is off, and no fault of the cable.
 2. Corrupted or lost replies of all: termination, bias, noise, or the cable before the first one.
 3. Of all from one on: the cable before it. Of others among good ones: connectors, or the starters.
 4. Late replies are a matter of the starter's response time; of all starters, of the adapter's.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from math import inf, sqrt
from typing import Any, NamedTuple

from gateway.contract import EventCode, phrase

JUDGED_EVERY_S = 25.0
WINDOW_S, LONGEST_WINDOW_S = 300.0, 3600.0
LEAST, ENOUGH = 50, 300  # requests before anything is said of a starter; before all is, and of a window
BAD = 0.02  # a share of the replies
IN_ROW = 4  # findings, before words appear or go
MOST_NAMED = 6  # starters in a sentence
CONFIDENCE = 2.576  # standard deviations: 99 % of a normal distribution, both sides

_Key = tuple[str, tuple[str, ...]]  # the same finding with other numbers has the same case and starters


class WiredStarter(NamedTuple):
    """A starter at its place along the cable."""

    name: str
    address: int
    response_time_s: float  # how long it may take to a read


class CableChanges(NamedTuple):
    """Sentences that have just appeared, and those that hold no longer."""

    appeared: tuple[str, ...] = ()
    gone: tuple[str, ...] = ()


class Counts(NamedTuple):
    """Requests to a starter that answers, and the missing replies by kind."""

    asked: int = 0
    corrupted: int = 0
    lost: int = 0
    late: int = 0

    def plus(self, other: Counts, sign: int = 1) -> Counts:
        """Return the sum; with sign -1 the difference."""
        return Counts(*(mine + sign * theirs for mine, theirs in zip(self, other, strict=True)))

    @property
    def bad(self) -> int:
        """Replies that were corrupted or lost: a cable makes both."""
        return self.corrupted + self.lost


class CableHealth:
    """The cable of one line; its starters in the order in which the cable passes them."""

    def __init__(self, starters: Sequence[WiredStarter]) -> None:
        self._starters = [_Starter(starter) for starter in starters]
        self._judged_s = -inf
        self._findings: deque[dict[_Key, str]] = deque(maxlen=IN_ROW)  # the latest
        self._shown: dict[_Key, str] = {}

    def rewire(self, starters: Sequence[WiredStarter]) -> None:
        """Go on with another order or other starters; what is known of those that stay, stays known."""
        known = {starter.wired: starter for starter in self._starters}
        self._starters = [known.get(wired) or _Starter(wired) for wired in starters]

    def take(self, statistics: Mapping[str, Any], now_s: float) -> CableChanges:
        """Judge by a line's statistics; at most once in 25 s, before that nothing changes."""
        if now_s - self._judged_s < JUDGED_EVERY_S or not statistics.get("is_open", True):
            return CableChanges()
        self._judged_s = now_s
        for starter in self._starters:
            unit = statistics.get("units", {}).get(starter.wired.address)
            if unit is not None:
                starter.take(unit, now_s)
        found = dict([*_silent(self._starters), *_errors(self._starters), *_late(self._starters)])
        self._findings.append(found)
        before, times = self._shown, Counter(key for each in self._findings for key in each)
        appeared = [key for key in found if key not in before and times[key] == IN_ROW]
        gone = [key for key in before if not times[key]]
        stays = [key for key in before if key not in gone]
        self._shown = {key: found.get(key) or before[key] for key in (*stays, *appeared)}
        return CableChanges(tuple(found[key] for key in appeared), tuple(before[key] for key in gone))

    def to_dict(self) -> dict[str, Any]:
        """Return the words and rates of `B/gateway/line/{line}`."""
        rates = {starter.wired.name: starter.rates() for starter in self._starters if starter.is_known}
        return {"texts": list(self._shown.values()), "starters": rates}


class _Starter:
    """One starter's counters of this window and the one before, and the judgement of them."""

    def __init__(self, wired: WiredStarter) -> None:
        self.wired = wired
        self.counts = Counts()  # of both windows
        self.is_offline = self.is_bad = self.is_late = False
        self._windows = [(-inf, Counts())]  # the latest two: when each began, and the sums then
        self._sums = Counts()
        self._latest: Counts | None = None  # as the line has counted

    @property
    def name(self) -> str:
        return phrase(EventCode.CABLE, "address", name=self.wired.name, address=self.wired.address)

    @property
    def is_known(self) -> bool:
        """Whether enough was asked to say something of it."""
        return not self.is_offline and self.counts.asked >= LEAST

    @property
    def is_undecided(self) -> bool:
        """Whether it is neither bad nor good for sure."""
        return not self.is_bad and bounds(self.counts.bad, self.counts.asked)[1] >= BAD

    def take(self, unit: Mapping[str, Any], now_s: float) -> None:
        """Add what was counted since the last call, unless it does not answer at all, and judge."""
        was_offline, self.is_offline = self.is_offline, unit.get("state") == "silent"
        late = unit.get("late", 0)
        counted = Counts(unit["asked"], unit.get("corrupted", 0), max(unit["silent"] - late, 0), late)
        before, self._latest = self._latest, counted
        if before and before.asked <= counted.asked and not was_offline and not self.is_offline:
            self._sums = self._sums.plus(counted.plus(before, -1))
        age_s, asked = now_s - self._windows[-1][0], self._sums.asked - self._windows[-1][1].asked
        if (age_s >= WINDOW_S and asked >= ENOUGH) or age_s >= LONGEST_WINDOW_S:
            self._windows = [self._windows[-1], (now_s, self._sums)]
        self.counts = self._sums.plus(self._windows[0][1], -1)
        if self.counts.asked >= LEAST:
            self.is_bad = _is_bad(self.counts.bad, self.counts.asked, was_bad=self.is_bad)
            self.is_late = _is_bad(self.counts.late, self.counts.asked, was_bad=self.is_late)

    def rates(self) -> dict[str, float | int]:
        """Return the shares of corrupted, lost and late replies."""
        asked, *counts = self.counts
        names = ("error_rate", "silent_rate", "late_rate")
        shares = {name: round(count / asked, 5) for name, count in zip(names, counts, strict=True)}
        return {"asked": asked, **shares}


def bounds(count: int, of: int) -> tuple[float, float]:
    """Return between what the share `count / of` lies with 99 % confidence (Wilson score interval)."""
    square, share = CONFIDENCE * CONFIDENCE, count / of
    middle = (share + square / (2 * of)) / (1 + square / of)
    half = CONFIDENCE / (1 + square / of) * sqrt(share * (1 - share) / of + square / (4 * of * of))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _is_bad(count: int, of: int, *, was_bad: bool) -> bool:
    least, most = bounds(count, of)
    return least > BAD or (was_bad and most >= BAD)


def _silent(starters: Sequence[_Starter]) -> Iterator[tuple[_Key, str]]:
    """Yield the finding about several starters at the end that do not answer at all."""
    silent = [starter for starter in starters if starter.is_offline]
    first = len(starters) - len(silent)
    if len(silent) < 2 or silent != starters[first:]:
        return
    if first == 0:
        yield ("none", ()), phrase(EventCode.CABLE, "none", count=len(silent))
    else:
        begin, before = silent[0].name, starters[first - 1].name
        words = phrase(EventCode.CABLE, "end", starter=begin, before=before, count=len(silent))
        yield ("end", (begin,)), words


def _errors(starters: Sequence[_Starter]) -> Iterator[tuple[_Key, str]]:
    """Yield the finding about corrupted and lost replies, once it is clear which starters are good."""
    known = [starter for starter in starters if starter.is_known]
    bad = [starter for starter in known if starter.is_bad]
    if not bad or any(starter.is_undecided and starter.counts.asked < ENOUGH for starter in known):
        return
    first, numbers, names = known.index(bad[0]), _numbers(bad), tuple(starter.name for starter in bad)
    if len(bad) == 1:
        yield ("one", names), phrase(EventCode.CABLE, "one", starter=names[0], numbers=numbers)
    elif len(bad) == len(known):
        yield ("all", ()), phrase(EventCode.CABLE, "all", numbers=numbers)
    elif bad == known[first:]:
        before = known[first - 1].name
        words = phrase(EventCode.CABLE, "from", starter=names[0], before=before, numbers=numbers)
        yield ("from", names[:1]), words
    else:
        yield ("some", names), phrase(EventCode.CABLE, "some", starters=_listed(names), numbers=numbers)


def _late(starters: Sequence[_Starter]) -> Iterator[tuple[_Key, str]]:
    """Yield the findings about replies that come too late."""
    known = [starter for starter in starters if starter.is_known]
    late = [starter for starter in known if starter.is_late]
    if len(late) > 1 and len(late) == len(known):
        asked, count = (sum(starter.counts[at] for starter in late) for at in (0, 3))
        share = _percent(count / asked)
        yield ("late_all", ()), phrase(EventCode.CABLE, "late_all", share=share, asked=asked)
        return
    for starter in late:
        asked, limit_ms = starter.counts.asked, starter.wired.response_time_s * 1000
        share, name = _percent(starter.counts.late / asked), starter.name
        words = phrase(EventCode.CABLE, "late", starter=name, limit_ms=limit_ms, share=share, asked=asked)
        yield ("late", (name,)), words


def _numbers(starters: Sequence[_Starter]) -> str:
    asked, corrupted, lost = (sum(starter.counts[at] for starter in starters) for at in range(3))
    share = _percent((corrupted + lost) / asked)
    return phrase(EventCode.CABLE, "numbers", share=share, asked=asked, corrupted=corrupted, lost=lost)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if share < 0.1 else f"{100 * share:.0f} %"


def _listed(names: Sequence[str]) -> str:
    shown, more = ", ".join(names[:MOST_NAMED]), len(names) - MOST_NAMED
    return phrase(EventCode.CABLE, "more", names=shown, count=more) if more > 0 else shown
