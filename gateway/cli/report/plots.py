"""Plots of curves as SVG, small enough to stand in a page, without a library.

Lengths are in user units of about a third of a millimetre on A4. The kind of a curve is its CSS class,
which also differs in a print without colour.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from math import ceil, log10
from typing import NamedTuple

LEFT, RIGHT, TOP, BELOW = 46.0, 10.0, 16.0, 17.0  # room for the axes
NAME_WIDTH = 38.0  # of a name below the x axis

Point = tuple[float, float]


class PlotLine(NamedTuple):
    """A line through points."""

    points: Sequence[Point]
    kind: str  # latest, earlier, baseline, limit


class Plot(NamedTuple):
    """Curves over one pair of axes; 0 is on the y axis where it is near."""

    label: str  # of the y axis, and of x where it has numbers
    curves: Sequence[PlotLine]
    names: Sequence[str] = ()  # of x = 0, 1 ... in place of numbers
    width: float = 560.0
    height: float = 142.0

    def svg(self) -> str:
        """Return the plot as an element."""
        label = escape(self.label, quote=True)
        return (
            f'<svg viewBox="0 0 {self.width:g} {self.height:g}" role="img" aria-label="{label}" '
            f'xmlns="http://www.w3.org/2000/svg">{"".join(self._parts())}</svg>'
        )

    def _parts(self) -> Iterator[str]:
        xs, ys = ([point[at] for curve in self.curves for point in curve.points] for at in (0, 1))
        x_ticks, y_ticks = self._x_ticks(xs), self._y_ticks(ys)
        left, right, bottom = LEFT, self.width - RIGHT, self.height - BELOW
        x_scale = (right - left) / (x_ticks[-1] - x_ticks[0])
        y_scale = (bottom - TOP) / (y_ticks[-1] - y_ticks[0])

        def at(point: Point) -> Point:
            return left + (point[0] - x_ticks[0]) * x_scale, bottom - (point[1] - y_ticks[0]) * y_scale

        for y in y_ticks:
            height = at((x_ticks[0], y))[1]
            yield f'<path class="grid" d="M{left:g} {height:.4g}H{right:g}"/>'
            yield _text((left - 5, height + 3.2), f"{y:g}", "end")
        step = ceil(len(self.names) * NAME_WIDTH / (right - left))
        names = list(enumerate(self.names))[::step] if self.names else [(x, f"{x:g}") for x in x_ticks]
        for x, name in names:
            yield _text((at((x, 0.0))[0], bottom + 12), name, "middle")
        yield _text((2.0, 8.0), self.label, "start")
        for curve in self.curves:
            # A step of no length at the end makes a dot of a curve that has one point only.
            steps = " ".join(f"{x:.4g} {y:.4g}" for x, y in map(at, curve.points))
            yield f'<path class="curve {escape(curve.kind)}" d="M{steps}h0"/>'

    def _x_ticks(self, xs: Sequence[float]) -> list[float]:
        if self.names:
            return [-0.6, len(self.names) - 0.4]
        return ticks(min(xs, default=0.0), max(xs, default=1.0), about=8)

    def _y_ticks(self, ys: Sequence[float]) -> list[float]:
        least, most = min(ys, default=0.0), max(ys, default=1.0)
        return ticks(min(0.0, least) if least < 0.4 * most else least, most, about=5)


def ticks(least: float, most: float, *, about: int) -> list[float]:
    """Return round numbers from below the least to above the most value, about so many."""
    rough = ((most - least) or max(abs(most), 1.0)) / about
    power = 10.0 ** (log10(rough) // 1)
    step = next(factor * power for factor in (1, 2, 2.5, 5, 10) if factor * power >= rough * 0.999)
    first, last = int((least / step + 1e-9) // 1), ceil(most / step - 1e-9)
    return [number * step for number in range(first, max(last, first + 1) + 1)]


def _text(at: Point, text: str, anchor: str) -> str:
    return f'<text x="{at[0]:.4g}" y="{at[1]:.4g}" text-anchor="{anchor}">{escape(text)}</text>'
