"""The bench's two pictures as SVG text. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from xml.sax.saxutils import escape

from tests.lab.bench.account import Account, Law, SeenRequest

COLOURS = {"line": "#0b6e4f", "gateway": "#6bbf59", "pymodbus": "#c8553d", "minimalmodbus": "#8d99ae"}
PARTS = {
    "request": "#1d3557",
    "response delay": "#c9d6df",
    "reply": "#457b9d",
    "silence": "#f1faee",
    "lost": "#f4a261",
    "silence broken": "#d62828",
}
_LOWEST = 0.94  # where the bars begin
_HIGHEST = 1.0


def efficiency_picture(
    found: Mapping[tuple[str, int, bool], Account], colours: Mapping[str, str] = COLOURS
) -> str:
    """Draw efficiency by speed: full bars in one chunk, light ones byte by byte; broken silences in words."""
    masters = list(dict.fromkeys(master for master, _, _ in found))
    bauds = sorted({baud for _, baud, _ in found})
    parts = [_text(16, 24, "Efficiency: physical limit / elapsed, median of transactions", size=15)]
    parts += _scale()
    for place, master in enumerate(masters):
        parts.append(_box(16 + 170 * place, 40, 12, 12, colours[master]))
        parts.append(_text(34 + 170 * place, 50, master))
    for group, baud in enumerate(bauds):
        left = 60 + group * 230
        parts.append(_text(left + 62, 312, f"{baud} bit/s"))
        for place, master in enumerate(masters):
            for is_bytewise in (False, True):
                at = left + place * 48 + (20 if is_bytewise else 0)
                parts += _bar(at, found[master, baud, is_bytewise], colours[master], is_light=is_bytewise)
    parts.append(_text(16, 340, "Left bar: replies in one chunk; right bar: byte by byte. From 0.94 to 1."))
    parts.append(_text(16, 358, "Red: requests that broke the silence; such a line has no efficiency."))
    return _drawing(770, 372, parts)


def _scale() -> list[str]:
    parts = []
    for step in range(7):
        value = _LOWEST + step / 100
        y = _height(value)
        parts.append(f'<line x1="50" y1="{y:.1f}" x2="750" y2="{y:.1f}" stroke="#ddd"/>')
        parts.append(_text(14, y + 4, f"{value:.2f}"))
    return parts


def _bar(at: float, found: Account, colour: str, *, is_light: bool) -> list[str]:
    if found.too_soon > found.requests / 100:
        share = found.too_soon / found.requests
        return [_turned(at + 14, 288, f"{share:.0%} too soon", fill=PARTS["silence broken"])]
    top = _height(min(max(found.efficiency, _LOWEST), _HIGHEST))
    bar = _box(at, top, 18, 292 - top, colour, opacity=0.6 if is_light else 1.0)
    return [bar, _turned(at + 13, 288, f"{found.efficiency:.3f}", fill="#fff")]


def _height(value: float) -> float:
    return 292 - (value - _LOWEST) / (_HIGHEST - _LOWEST) * 220


def line_time_picture(runs: Mapping[str, tuple[Sequence[SeenRequest], Law]], *, seconds: float = 0.16) -> str:
    """Draw what each master's line did in a span of time, as bars."""
    parts = [_text(16, 24, f"{seconds * 1e3:.0f} ms of the line's time", size=15)]
    for place, (name, colour) in enumerate(PARTS.items()):
        parts.append(_box(16 + 122 * place, 38, 12, 12, colour))
        parts.append(_text(34 + 122 * place, 48, name))
    for row, (master, (seen, law)) in enumerate(runs.items()):
        top = 70 + row * 44
        parts.append(_text(16, top + 18, master))
        parts += _time_bars(seen, law, top, seconds)
    return _drawing(770, 80 + 44 * len(runs), parts)


def _time_bars(seen: Sequence[SeenRequest], law: Law, top: float, seconds: float) -> list[str]:
    parts = []
    begun_s = seen[0].start_s if seen else 0.0
    for each, following in pairwise(seen):
        if following.start_s > begun_s + seconds:
            break
        at_s = each.start_s
        for name, length_s in _pieces(each, following, law):
            x, width = (_x(at_s - begun_s, seconds), _x(length_s, seconds) - _x(0, seconds))
            parts.append(_box(x, top, width, 26, PARTS[name]))
            at_s += length_s
    return parts


def _pieces(each: SeenRequest, following: SeenRequest, law: Law) -> list[tuple[str, float]]:
    """Return what the time of a request consists of, in order."""
    request_s = law.timing.wire_s(each.request_size)
    reply_s = law.timing.wire_s(each.reply_size)
    after_s = following.start_s - each.end_s
    before_s = each.end_s - each.start_s - request_s - reply_s
    silence_s = law.timing.silence_s
    pieces = [("request", request_s), ("response delay", before_s), ("reply", reply_s)]
    if law.is_too_soon(following):
        return [*pieces, ("silence broken", max(after_s, 0.0))]
    return [*pieces, ("silence", min(after_s, silence_s)), ("lost", max(after_s - silence_s, 0.0))]


def _x(at_s: float, seconds: float) -> float:
    return 120 + at_s / seconds * 640


def _box(x: float, y: float, width: float, height: float, fill: str, *, opacity: float = 1.0) -> str:
    return (
        f'<rect x="{x:.2f}" y="{y:.1f}" width="{width:.2f}" height="{height:.1f}" fill="{fill}"'
        f' fill-opacity="{opacity:g}" stroke="#999" stroke-width="0.2"/>'
    )


def _text(x: float, y: float, text: str, *, size: int = 12) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="#222">{escape(text)}</text>'


def _turned(x: float, y: float, text: str, *, fill: str) -> str:
    rotation = f'transform="rotate(-90 {x:.1f} {y:.1f})"'
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="11" fill="{fill}" {rotation}>{escape(text)}</text>'


def _drawing(width: int, height: int, parts: Sequence[str]) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}"'
        f' height="{height}" font-family="sans-serif">'
    )
    ground = f'<rect width="{width}" height="{height}" fill="#fff"/>'
    return "\n".join([head, ground, *parts, "</svg>", ""])
