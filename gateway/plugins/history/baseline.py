"""Whether a motor still starts as it did: its baseline, the drift against it, the means of each month.

The baseline is the median of the first five good starts, or one start that an operator has chosen. A drift is
raised when the median of the last nine starts is beyond 15 % and beyond three times the usual scatter, in the
same quantity, after two starts in a row; it is over when all quantities are back within two thirds of that,
after two starts in a row. Of a motor whose current is not measured (no current transformer: it reads 0) only
the acceleration time is compared. A median counts when more than half of its starts have the quantity.

The scatter is computed from the differences of starts that follow each other (median moving range / 0.954,
the standard deviation of normal noise; NIST/SEMATECH e-Handbook 6.3.2.2), not from the deviations from their
median: those grow with the very drift that is looked for. It is an estimate, so its uncertainty is added:
2 / sqrt(n) of it. Nine starts instead of five, because the median of five scatters more: of 400 simulated
motors with a scatter of 8 %, 6 raised a drift within 500 equal starts, with nine starts 2; with the plain
median deviation of the last 20 and five starts it was one of five motors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import pairwise
from statistics import median

from gateway.contract import QuantityChange, StartOutcome, StartRecord

FIRST = 5  # good starts that make the baseline
LAST = 9  # starts whose median is compared with it
SCATTER_OF = 50  # starts that show the usual scatter
LIMIT_PCT = 15.0
SCATTERS = 3.0
OVER_BELOW = 2 / 3  # of the limits: a drift is over
MOST_ERROR_PCT = 10.0  # plus or minus; an acceleration time or an I2t that is known less well is not compared
MEDIAN_MOVING_RANGE = 0.954  # in standard deviations, of normal noise: sqrt(2) * 0.6745

QUANTITIES = {"acceleration_s": "acceleration time", "i2t_a2s": "I2t", "peak_a": "peak current"}
_UNITS = {"acceleration_s": "s", "i2t_a2s": "A²s", "peak_a": "A"}
_MEANS = (*QUANTITIES, "mean_a", "lowest_v", "heating_pct")  # of a month

Values = Mapping[str, float]  # those of QUANTITIES that are known, always the acceleration time


def values_of(start: StartRecord) -> Values | None:
    """Return what of a start is compared; None when it is not good enough for that."""
    acceleration_s, heat, peak_a = start.acceleration_s, start.i2t_a2s, start.peak_a
    if start.outcome != "full_voltage" or acceleration_s is None or acceleration_s <= 0:
        return None
    if (start.resolution_s or 0.0) > MOST_ERROR_PCT / 100 * acceleration_s:
        return None
    is_sampled = (start.i2t_error_pct or 0.0) <= MOST_ERROR_PCT
    if not heat or not peak_a or not is_sampled:  # also 0: the motor's current is not measured
        return {"acceleration_s": acceleration_s}
    return {"acceleration_s": acceleration_s, "i2t_a2s": heat, "peak_a": peak_a}


@dataclass(frozen=True, slots=True)
class Baseline:
    """The start that later ones are compared with."""

    values: Values
    starts: tuple[str, ...]  # ids of the starts that it was made of
    typical: str  # of these the one whose acceleration time is the nearest: its curve is shown
    client: str | None = None  # who has set it; None: the first good starts
    is_raised: bool = False  # a drift against it
    text: str = ""  # of the drift that was raised last
    alarm_count: int = 0  # drifts of this motor
    raised_s: float | None = None  # when the latest was, UTC


NOTHING = Baseline({}, (), "")


@dataclass(frozen=True, slots=True)
class TrendVerdict:
    """The verdict of a start about the motor."""

    is_baseline: bool = False  # it is one of those that make the baseline
    drift: Mapping[str, QuantityChange] = field(default_factory=dict)  # of all quantities, once it is known
    raised: str = ""  # in words what has changed, when the drift is raised by this start
    is_over: bool = False  # the drift is over by this start


class Trend:
    """The baseline of one motor, and the drift of its starts against it."""

    def __init__(self) -> None:
        self.baseline: Baseline | None = None
        self._recent: list[tuple[str, Values]] = []  # good starts, since the baseline if there is one
        self._beyond: frozenset[str] = frozenset()  # quantities beyond their limits after the latest start
        self._is_back = False  # all were back after the latest start

    def restore(self, starts: Iterable[StartRecord], stored: Baseline | None) -> None:
        """Go on from the starts of earlier runs, the oldest first, and from their baseline."""
        known = [(each.id, values) for each in starts if (values := values_of(each)) is not None]
        self.baseline = stored
        if stored is None:
            for id_, values in known:
                self._add(id_, values)
        else:
            self._recent = _since(stored, known)

    def add(self, start: StartRecord, *, now_s: float = 0.0) -> TrendVerdict:
        """Count a start that is over now, UTC."""
        values = values_of(start)
        if values is None:
            return TrendVerdict()
        baseline = self.baseline
        self._add(start.id, values)
        return TrendVerdict(is_baseline=True) if baseline is None else self._judged(baseline, now_s)

    def set_baseline(self, chosen: StartRecord, *, client: str) -> bool:
        """Compare with this start from now on; False when it is not good enough.

        Only this start and those after it count; a drift that was raised is over.
        """
        values = values_of(chosen)
        if values is None:
            return False
        before = self.baseline or NOTHING
        self.baseline = replace(
            before, values=values, starts=(chosen.id,), typical=chosen.id, client=client, is_raised=False
        )
        self._recent = _since(self.baseline, self._recent)
        self._beyond, self._is_back = frozenset(), False
        return True

    def _add(self, id_: str, values: Values) -> None:
        """Count a good start; the first ones make the baseline."""
        self._recent = [*self._recent, (id_, values)][-SCATTER_OF:]
        if self.baseline is not None or len(self._recent) < FIRST:
            return
        medians = {name: _median([each for _, each in self._recent], name) for name in QUANTITIES}
        usual = {name: value for name, value in medians.items() if value is not None}
        typical, _ = min(
            self._recent, key=lambda each: abs(each[1]["acceleration_s"] - usual["acceleration_s"])
        )
        self.baseline = Baseline(usual, tuple(id_ for id_, _ in self._recent), typical)

    def _judged(self, baseline: Baseline, now_s: float) -> TrendVerdict:
        """Compare the last starts with the baseline, and raise or end a drift."""
        later = [values for id_, values in self._recent if id_ not in baseline.starts]
        if len(later) < LAST:
            return TrendVerdict()
        drift, ratios = {}, {}
        for name, usual in baseline.values.items():
            now = _median(later[-LAST:], name)
            if now is None:
                continue
            scatter = _scatter([values[name] for _, values in self._recent if name in values])
            drift[name] = QuantityChange(usual, now, 100 * (now - usual) / usual)
            ratios[name] = abs(now - usual) / max(LIMIT_PCT / 100 * usual, SCATTERS * scatter)
        beyond_before, was_back = self._beyond, self._is_back
        self._beyond = beyond = frozenset(name for name, ratio in ratios.items() if ratio > 1)
        self._is_back = all(ratio < OVER_BELOW for ratio in ratios.values())
        if baseline.is_raised and self._is_back and was_back:
            self.baseline = replace(baseline, is_raised=False)
            return TrendVerdict(drift=drift, is_over=True)
        if baseline.is_raised or not beyond & beyond_before:
            return TrendVerdict(drift=drift)
        text = "; ".join(_in_words(name, drift[name]) for name in QUANTITIES if name in beyond)
        count = baseline.alarm_count + 1
        self.baseline = replace(baseline, is_raised=True, text=text, alarm_count=count, raised_s=now_s)
        return TrendVerdict(drift=drift, raised=text)


def _since(baseline: Baseline, known: Sequence[tuple[str, Values]]) -> list[tuple[str, Values]]:
    """Return the starts from the baseline's first on."""
    ids = [id_ for id_, _ in known]
    first = next((ids.index(id_) for id_ in baseline.starts if id_ in ids), 0)
    return list(known[first:][-SCATTER_OF:])


def _median(starts: Sequence[Values], name: str) -> float | None:
    """Return the median of a quantity; None when half of the starts or more do not have it."""
    known = [values[name] for values in starts if name in values]
    return median(known) if 2 * len(known) > len(starts) else None


def _scatter(values: Sequence[float]) -> float:
    """Return the usual scatter of one start, on the safe side; infinite when nothing shows it."""
    ranges = [abs(after - before) for before, after in pairwise(values)]
    if not ranges:
        return math.inf
    return median(ranges) / MEDIAN_MOVING_RANGE * (1 + 2 / math.sqrt(len(ranges)))


def _in_words(name: str, change: QuantityChange) -> str:
    way = "grew" if change.change_pct > 0 else "fell"
    values = f"{_brief(change.baseline)} {_UNITS[name]} to {_brief(change.median)} {_UNITS[name]}"
    return f"{QUANTITIES[name]} {way} by {abs(change.change_pct):.0f} %, {values}"


def _brief(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


@dataclass(slots=True)
class Mean:
    """The mean of a quantity."""

    count: int = 0
    mean: float = 0.0


@dataclass(slots=True)
class Month:
    """The means of one month's starts that reached full voltage, and how all of them ended."""

    month: str  # 2026-11, UTC
    outcomes: dict[StartOutcome, int] = field(default_factory=dict)
    means: dict[str, Mean] = field(default_factory=dict)

    @property
    def starts(self) -> int:
        """Return how many starts there were."""
        return sum(self.outcomes.values())

    def mean(self, quantity: str) -> float | None:
        """Return the mean of a quantity; None where it is not known."""
        known = self.means.get(quantity)
        return None if known is None else known.mean

    def add(self, start: StartRecord) -> None:
        """Count a start."""
        self.outcomes[start.outcome] = self.outcomes.get(start.outcome, 0) + 1
        if start.outcome != "full_voltage":
            return
        for quantity in _MEANS:
            value = getattr(start, quantity)
            if value is not None:
                known = self.means.setdefault(quantity, Mean())
                known.count += 1
                known.mean += (value - known.mean) / known.count


def month_of(time_s: float) -> str:
    """Return the month of a time, UTC."""
    return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m}"
