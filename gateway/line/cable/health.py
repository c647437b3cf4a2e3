"""What is known of a line's cable: judged every half minute, without flicker, never from too few requests.

A starter is bad when the 99 % Wilson interval of its share of corrupted and lost replies lies above 2 % of
the last ten minutes (of the last hour or day, where that has too few requests), or above 0.5 % of the last
day while ten minutes and the last hour do not contradict that. It is good again when the interval lies below.
In between it stays what it was. A sentence appears, and goes, when four judgements in a row agree; another
one about the same takes its place after ten.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import inf
from typing import Any, NamedTuple

from gateway.contract import EventCode, phrase
from gateway.line.cable.counts import DAY_S, ENOUGH, HOUR_S, LATELY_S, Counts, StarterCounts, bounds
from gateway.line.cable.diagnosis import CableFinding, Fact, WiredStarter, findings

LEAST = 50  # requests, before anything is said
BAD_LATELY, BAD_OF_DAY, LATE = 0.02, 0.005, 0.02  # shares
NEAR_LIMIT, OFF_LIMIT = 0.8, 0.6  # of the response time: slow from there on, until it is below that
CHRONIC_FROM = 5000  # requests of a day
JUDGED_EVERY_S = 25.0
_UART = ("framing", "parity", "break", "overrun")

IN_ROW = 4  # judgements, before a sentence appears or goes
REPLACED_AFTER = 10  # judgements, before another about the same stands in its place

_Key = tuple[str, tuple[str, ...]]
_WINDOWS = {LATELY_S: "in 10 min", HOUR_S: "in 1 h", DAY_S: "in 24 h"}


class CableChanges(NamedTuple):
    """Sentences that have just appeared, and those that hold no more."""

    appeared: tuple[str, ...] = ()
    gone: tuple[str, ...] = ()


class CableHealth:
    """The cable of one line; its starters in the order in which the cable passes them."""

    def __init__(self, starters: Sequence[WiredStarter]) -> None:
        self._judges = [_StarterJudge(starter) for starter in starters]
        self._judged_s = -inf
        self._shown: dict[_Key, CableFinding] = {}
        self._seen: dict[_Key, int] = {}  # judgements in a row
        self._missed: dict[_Key, int] = {}
        self._uart: deque[tuple[float, dict[str, int]]] = deque()

    def rewire(self, starters: Sequence[WiredStarter]) -> None:
        """Go on with another order or other starters; what is known of those that stay, stays known."""
        known = {judge.starter: judge for judge in self._judges}
        self._judges = [known.get(starter) or _StarterJudge(starter) for starter in starters]

    def take(self, statistics: Mapping[str, Any], now_s: float) -> CableChanges:
        """Judge by a line's statistics; at most once in 25 s, before that nothing changes."""
        if now_s - self._judged_s < JUDGED_EVERY_S or not statistics.get("is_open", True):
            return CableChanges()
        self._judged_s = now_s
        units = statistics.get("units", {})
        for judge in self._judges:
            judge.take(units.get(judge.starter.address), now_s)
        is_acute = any(judge.is_acute for judge in self._judges)
        facts = [judge.fact(now_s, is_of_day=not is_acute) for judge in self._judges]
        found = {each.key: each for each in findings(facts, more=self._uart_text(statistics, now_s))}
        return self._show(found)

    def _show(self, found: Mapping[_Key, CableFinding]) -> CableChanges:
        """Show what was found often enough in a row, no longer what was not."""
        self._seen = {key: self._seen.get(key, 0) + 1 for key in found}
        self._missed = {key: self._missed.get(key, 0) + 1 for key in self._shown if key not in found}
        groups = {finding.group for finding in self._shown.values()}
        appeared = [
            key
            for key, count in self._seen.items()
            if key not in self._shown and count >= (REPLACED_AFTER if found[key].group in groups else IN_ROW)
        ]
        replaced = {found[key].group for key in appeared}
        waiting = {found[key].group for key in found if key not in self._shown} - replaced
        gone = [
            key
            for key, count in self._missed.items()
            if count >= IN_ROW and self._shown[key].group not in waiting
        ]
        changes = CableChanges(
            tuple(found[key].text for key in appeared), tuple(self._shown[key].text for key in gone)
        )
        shown = [key for key in self._shown if key not in gone] + appeared
        self._shown = {key: found.get(key) or self._shown[key] for key in shown}
        return changes

    def to_dict(self) -> dict[str, Any]:
        """Return what `B/gateway/line/{line}` says of the cable; rates over ten minutes, or what decides."""
        starters = {judge.starter.name: judge.rates() for judge in self._judges}
        return {
            "texts": [finding.text for finding in self._shown.values()],
            "starters": {name: rates for name, rates in starters.items() if rates},
        }

    def _uart_text(self, statistics: Mapping[str, Any], now_s: float) -> str:
        """Return what the UART has counted in the last ten minutes; empty when that is nothing."""
        errors = statistics.get("uart_errors")
        if not errors:
            return ""
        self._uart.append((now_s, dict(errors)))
        while self._uart[0][0] < now_s - LATELY_S:
            self._uart.popleft()
        first = self._uart[0][1]
        new = {name: errors.get(name, 0) - first.get(name, 0) for name in _UART}
        counts = ", ".join(f"{count} {name}" for name, count in new.items() if count > 0)
        return phrase(EventCode.CABLE, "uart", counts=counts) if counts else ""


class _StarterJudge:
    """What is sure of one starter."""

    def __init__(self, starter: WiredStarter) -> None:
        self.starter = starter
        self.is_acute = False  # bad by what was lately
        self._counts = StarterCounts()
        self._is_chronic = self._is_late = self._is_slow = False  # chronic: bad by the day
        self._lately, self._span_s = Counts(), DAY_S
        self._p99_s: float | None = None

    def take(self, unit: Mapping[str, Any] | None, now_s: float) -> None:
        """Judge by this much more."""
        if unit is None:
            return
        self._counts.take(unit, now_s)
        self._note_time(unit.get("response_time_s", {}).get("p99"))
        windows = {span_s: self._counts.since(span_s, now_s) for span_s in _WINDOWS}
        self._span_s = next((each for each in windows if windows[each].asked >= ENOUGH), DAY_S)
        self._lately = counts = windows[self._span_s]
        if counts.asked < LEAST:
            return
        least, most = bounds(counts.bad, counts.asked)
        self.is_acute = least > BAD_LATELY or (self.is_acute and most >= BAD_LATELY)
        self._is_chronic = self._is_still_chronic(windows[HOUR_S], windows[DAY_S], most)
        late_least, late_most = bounds(counts.late, counts.asked)
        self._is_late = late_least > LATE or (self._is_late and late_most >= LATE)

    def fact(self, now_s: float, *, is_of_day: bool) -> Fact:
        """Return what is sure, with the counts of the day or of what was lately."""
        span_s = DAY_S if is_of_day else self._span_s
        counts = self._counts.since(DAY_S, now_s) if is_of_day else self._lately
        if counts.asked < LEAST:
            return Fact(self.starter, Counts(), "", is_offline=self._counts.is_offline)
        limit = BAD_OF_DAY if is_of_day else BAD_LATELY
        return Fact(
            self.starter,
            counts,
            _WINDOWS[span_s],
            is_offline=self._counts.is_offline,
            is_bad=self.is_acute or self._is_chronic,
            is_undecided=bounds(counts.bad, counts.asked)[1] >= limit,
            late=self._lately if self._is_late else None,
            p99_s=self._p99_s if self._is_slow else None,
        )

    def rates(self) -> dict[str, float | int]:
        """Return the shares of corrupted, lost and late replies; empty before enough was asked."""
        counts = self._lately
        if counts.asked < LEAST or self._counts.is_offline:
            return {}
        return {
            "asked": counts.asked,
            "error_rate": round(counts.corrupted / counts.asked, 5),
            "silent_rate": round(counts.lost / counts.asked, 5),
            "late_rate": round(counts.late / counts.asked, 5),
        }

    def _is_still_chronic(self, hour: Counts, day: Counts, most_lately: float) -> bool:
        """Return whether a low share lasts: the day shows it, and no shorter time is better."""
        if day.asked < CHRONIC_FROM:
            return False
        hour_most = bounds(hour.bad, hour.asked)[1]
        if min(most_lately, hour_most) < day.bad / day.asked / 2 or hour_most < BAD_OF_DAY / 2:
            return False
        least, most = bounds(day.bad, day.asked)
        return least > BAD_OF_DAY or (self._is_chronic and most >= BAD_OF_DAY)

    def _note_time(self, p99_s: float | None) -> None:
        self._p99_s = p99_s
        limit = OFF_LIMIT if self._is_slow else NEAR_LIMIT
        self._is_slow = p99_s is not None and p99_s > limit * self.starter.response_time_s
