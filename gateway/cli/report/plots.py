"""Plots as SVG: curves and columns, small enough to stand in a page, without a library.

Lengths are in user units of about a third of a millimetre on A4. All text is escaped; colours are those of a
print that also works without colour: the baseline is dashed and dark, the latest start the thickest.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from math import ceil, log10

DARK, LATEST, EARLIER, GRID, BAND = "#1b2a3a", "#c2410c", "#7fa8cf", "#dde3ea", "#eef3f8"
_LEFT, _RIGHT, _TOP = 46.0, 10.0, 16.0
_BELOW, _BELOW_LABELLED = 17.0, 29.0  # the x axis

Point = tuple[float, float]


@dataclass(frozen=True)
class PlotLine:
    """A line through points."""

    points: Sequence[Point]
    colour: str = DARK
    width: float = 1.0
    dashes: str = ""
    opacity: float = 1.0
    has_marks: bool = False


@dataclass
class Plot:
    """One pair of axes; the ranges include all that is added and 0 on the y axis where it is near."""

    width: float
    height: float
    x_label: str
    y_label: str
    curves: list[PlotLine] = field(default_factory=list)
    columns: Sequence[float] = ()  # one for each of `names`
    names: Sequence[str] = ()  # along the x axis, instead of numbers
    level: float | None = None  # a dashed line across
    band: tuple[float, float] | None = None  # a range that is usual
    from_zero: bool = True

    def svg(self) -> str:
        """Return the plot as an element."""
        x_ticks, y_ticks = self._x_ticks(), self._y_ticks()
        self._x_range = (x_ticks[0], x_ticks[-1]) if not self.names else (-0.6, len(self.names) - 0.4)
        self._y_range = (y_ticks[0], y_ticks[-1])
        parts = [*self._grid(x_ticks, y_ticks), *self._bars(), *map(self._path, self.curves)]
        if self.level is not None:
            parts.append(self._level(self.level))
        label = escape(f"{self.y_label} / {self.x_label}", quote=True)
        return (
            f'<svg viewBox="0 0 {_n(self.width)} {_n(self.height)}" role="img" aria-label="{label}" '
            f'xmlns="http://www.w3.org/2000/svg">{"".join(parts)}</svg>'
        )

    @property
    def _bottom(self) -> float:
        return self.height - (_BELOW_LABELLED if self.x_label else _BELOW)

    def _x_ticks(self) -> list[float]:
        values = [x for curve in self.curves for x, _ in curve.points]
        return ticks(min(values, default=0.0), max(values, default=1.0), 8) if not self.names else [0.0, 1.0]

    def _y_ticks(self) -> list[float]:
        values = [y for curve in self.curves for _, y in curve.points] + list(self.columns)
        values += [] if self.level is None else [self.level]
        values += self.band or ()
        least, most = min(values, default=0.0), max(values, default=1.0)
        least = 0.0 if self.from_zero or least < 0.4 * most else least
        return ticks(min(least, most), most, 5)

    def _x(self, x: float) -> float:
        low, high = self._x_range
        return _LEFT + (x - low) / (high - low) * (self.width - _LEFT - _RIGHT)

    def _y(self, y: float) -> float:
        low, high = self._y_range
        return self._bottom - (y - low) / (high - low) * (self._bottom - _TOP)

    def _grid(self, x_ticks: Sequence[float], y_ticks: Sequence[float]) -> list[str]:
        left, right = _n(_LEFT), _n(self.width - _RIGHT)
        bottom = self._bottom
        parts = []
        if self.band is not None:
            low, high = (self._y(each) for each in self.band)
            parts.append(
                f'<rect x="{left}" y="{_n(high)}" width="{_n(self.width - _LEFT - _RIGHT)}" '
                f'height="{_n(low - high)}" fill="{BAND}"/>'
            )
        for y in y_ticks:
            at = _n(self._y(y))
            parts.append(f'<path d="M{left} {at}H{right}" stroke="{GRID}"/>')
            parts.append(_text(_LEFT - 5, self._y(y) + 3.2, _tick(y, y_ticks), anchor="end"))
        for x, name in self._x_names(x_ticks):
            parts.append(_text(self._x(x), bottom + 12, name, anchor="middle"))
            if not self.names:
                parts.append(f'<path d="M{_n(self._x(x))} {_n(bottom)}v3" stroke="{DARK}"/>')
        parts.append(f'<path d="M{left} {_n(bottom)}H{right}" stroke="{DARK}"/>')
        if self.x_label:
            parts.append(_text(self.width - _RIGHT, self.height - 4, self.x_label, anchor="end"))
        parts.append(_text(2, 8, self.y_label, weight="600"))
        return parts

    def _x_names(self, x_ticks: Sequence[float]) -> Iterable[tuple[float, str]]:
        if not self.names:
            return [(x, _tick(x, x_ticks)) for x in x_ticks]
        step = max(1, ceil(len(self.names) / max((self.width - _LEFT) / 38, 1)))
        return [(float(at), name) for at, name in enumerate(self.names) if at % step == 0]

    def _bars(self) -> list[str]:
        half = 0.33 * (self.width - _LEFT - _RIGHT) / max(len(self.names), 1)
        base = self._y(max(self._y_range[0], 0.0))
        return [
            f'<rect x="{_n(self._x(at) - half)}" y="{_n(self._y(value))}" width="{_n(2 * half)}" '
            f'height="{_n(base - self._y(value))}" fill="{EARLIER}"/>'
            for at, value in enumerate(self.columns)
        ]

    def _path(self, curve: PlotLine) -> str:
        steps = " ".join(f"{_n(self._x(x))} {_n(self._y(y))}" for x, y in curve.points)
        dashes = f' stroke-dasharray="{curve.dashes}"' if curve.dashes else ""
        opacity = f' stroke-opacity="{_n(curve.opacity)}"' if curve.opacity < 1 else ""
        marks = [
            f'<circle cx="{_n(self._x(x))}" cy="{_n(self._y(y))}" r="2.2" fill="{curve.colour}"/>'
            for x, y in (curve.points if curve.has_marks else ())
        ]
        return (
            f'<path d="M{steps}" fill="none" stroke="{curve.colour}" stroke-width="{_n(curve.width)}" '
            f'stroke-linejoin="round"{dashes}{opacity}/>{"".join(marks)}'
        )

    def _level(self, level: float) -> str:
        end = f"H{_n(self.width - _RIGHT)}"
        return f'<path d="M{_n(_LEFT)} {_n(self._y(level))}{end}" stroke="{DARK}" stroke-dasharray="5 3"/>'


def ticks(least: float, most: float, about: int) -> list[float]:
    """Return round numbers from below the least to above the most value, about so many."""
    span = most - least if most > least else max(abs(most), 1.0)
    rough = span / about
    power = 10.0 ** (log10(rough) // 1)
    step = next(each * power for each in (1, 2, 2.5, 5, 10) if each * power >= rough * 0.999)
    first, last = int((least / step + 1e-9) // 1), ceil(most / step - 1e-9)
    last = max(last, first + 1)
    return [number * step for number in range(first, last + 1)]


def _tick(value: float, among: Sequence[float]) -> str:
    step = among[1] - among[0] if len(among) > 1 else 1.0
    digits = max(0, -int((log10(step) + 1e-9) // 1))
    if round(step, digits) != round(step, digits + 2):
        digits += 1
    return f"{value:.{digits}f}" if value else "0"


def _text(x: float, y: float, text: str, *, anchor: str = "start", weight: str = "") -> str:
    heavy = f' font-weight="{weight}"' if weight else ""
    return f'<text x="{_n(x)}" y="{_n(y)}" text-anchor="{anchor}"{heavy}>{escape(text)}</text>'


def _n(value: float) -> str:
    """Return a number with one digit behind the point, two where it is small."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if abs(value) < 2 else f"{value:.1f}".removesuffix(".0")
