"""Draws how the line is wired: one drawing of the whole line, and one of each family's terminals.

The terminals and the words about termination and shield are those of the manuals, as docs/families/ has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from xml.sax.saxutils import escape

PLUS, MINUS, REFERENCE, SHIELD = "#c2410c", "#1d4ed8", "#4b5563", "#15803d"
INK, PAPER = "#111827", "#ffffff"


class Wire(NamedTuple):
    """One wire: at the adapter, at the starter, and its colour."""

    adapter: str
    terminal: str
    colour: str
    is_optional: bool = False


class Terminals(NamedTuple):
    """What a family's manual prints."""

    title: str
    wires: tuple[Wire, ...]
    notes: tuple[str, ...]


FAMILIES: Mapping[str, Terminals] = {
    "ssw06": Terminals(
        "SSW-06, RS-485 kit (item 10927208) on XC8",
        (
            Wire("Data+", "1  A", PLUS),
            Wire("Data-", "2  B", MINUS),
            Wire("0 V", "3  reference", REFERENCE, is_optional=True),
            Wire("shield", "a point of the housing", SHIELD),
        ),
        (
            "A and B mean the opposite on the SSW900: go by Data+ and Data-.",
            "Terminal 3 may stay open where it is not used.",
            "Termination at the first and the last device: both switches S1 to ON (no value printed).",
        ),
    ),
    "ssw07": Terminals(
        "SSW-07 or SSW-08, Modbus RTU RS-485 kit",
        (
            Wire("one wire of the pair", "A", PLUS),
            Wire("the other wire", "B", MINUS),
            Wire("0 V", "COM", REFERENCE, is_optional=True),
            Wire("shield", "XC42", SHIELD),
        ),
        (
            "Which of A and B is Data+ is not printed: no answer means swap the two.",
            "COM may stay open; a shield that is earthed elsewhere goes to COM, not to XC42.",
            "Termination at the first and the last device: both switches of the card ON (no value printed).",
        ),
    ),
    "ssw900": Terminals(
        "SSW900, accessory SSW900-CRS485-W, connector X20",
        (
            Wire("Data+", "1  +B", PLUS),
            Wire("Data-", "2  -A", MINUS),
            Wire("0 V", "3  C", REFERENCE),
            Wire("shield", "4  earth", SHIELD),
        ),
        (
            "The letters mean the opposite on the SSW-06: go by Data+ and Data-.",
            "Termination 120 ohm at both ends: SW.1 and SW.2 both ON; both OFF elsewhere; never one alone.",
            "Use a third wire for 0 V; do not earth the shield at several different potentials.",
        ),
    ),
    "sst": Terminals(
        "SST130i, SST330i, SST360i, 3-pole header of the control board",
        (
            Wire("Data+", "D+ (D1)", PLUS),
            Wire("Data-", "D- (D0)", MINUS),
        ),
        (
            "The manual does not name the third pole, nor a terminal for the shield: ask the maker.",
            "Nothing is mounted on the line by default. On request: 150 ohm between D+ and D- (R705),",
            "a pull-up on D+ (R703) and a pull-down on D- (R704).",
        ),
    ),
}


def drawings() -> dict[str, str]:
    """Return the SVG files by their names below docs/."""
    families = {f"pictures/wiring-{name}.svg": _family(each) for name, each in FAMILIES.items()}
    return {"pictures/wiring-line.svg": _line(), **families}


def _family(family: Terminals) -> str:
    top, step = 88, 34
    bottom = top + step * len(family.wires)
    parts = [
        _text(20, 30, family.title, size=17, weight="bold"),
        _box(20, 50, 190, bottom - 60, "adapter, or device before"),
        _box(500, 50, 240, bottom - 60, "starter"),
    ]
    for place, wire in enumerate(family.wires):
        y = top + step * place
        parts += [
            _wire(210, y, 500, y, wire.colour, is_dashed=wire.is_optional),
            _text(200, y + 5, wire.adapter, anchor="end"),
            _text(510, y + 5, wire.terminal, weight="bold"),
        ]
    if len(family.wires) > 1:
        parts.append(_twist(250, 460, top, top + step))
    parts += [_text(20, bottom + 24 + 22 * n, note, size=14) for n, note in enumerate(family.notes)]
    return _svg(760, bottom + 34 + 22 * len(family.notes), family.title, parts)


def _line() -> str:
    parts = [
        _text(20, 30, "One line: from device to device, no branches, no star", size=17, weight="bold"),
        _box(20, 60, 150, 90, "adapter"),
        *[_box(250 + 180 * n, 60, 130, 90, name) for n, name in enumerate(("starter 1", "starter 2"))],
        _box(630, 60, 130, 90, "last starter"),
    ]
    for x, to in ((170, 250), (380, 430), (560, 630)):
        parts += [_wire(x, 98, to, 98, PLUS), _wire(x, 114, to, 114, MINUS)]
        parts.append(_wire(x, 130, to, 130, SHIELD, is_dashed=True))
    parts += [
        _text(95, 105, "Data+", anchor="middle"),
        _text(95, 125, "Data-", anchor="middle"),
        _text(95, 172, "termination, as the", size=13, anchor="middle"),
        _text(95, 189, "adapter's manual says", size=13, anchor="middle"),
        _text(695, 172, "termination, as the", size=13, anchor="middle"),
        _text(695, 189, "starter's manual says", size=13, anchor="middle"),
        _text(405, 172, "no termination in between", size=13, anchor="middle"),
        _text(20, 226, "Shielded twisted pair (green, dashed: the shield), at most 1000 m,", size=14),
        _text(
            20, 248, "apart from power cables; all devices on the same earth. More than 30 starters", size=14
        ),
        _text(20, 270, "(SSW900: 32) need a repeater.", size=14),
    ]
    return _svg(780, 290, "The line", parts)


def _svg(width: int, height: int, title: str, parts: list[str]) -> str:
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
            f'height="{height}" role="img" font-family="sans-serif">',
            f"<title>{escape(title)}</title>",
            f'<rect width="{width}" height="{height}" fill="{PAPER}"/>',
            *parts,
            "</svg>",
            "",
        ]
    )


def _box(x: int, y: int, width: int, height: int, name: str) -> str:
    rect = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="none" stroke="{INK}"/>'
    return rect + _text(x + width // 2, y + 17, name, size=13, anchor="middle")


def _text(x: int, y: int, text: str, *, size: int = 15, weight: str = "normal", anchor: str = "start") -> str:
    return (
        f'<text x="{x}" y="{y}" font-size="{size}" font-weight="{weight}" text-anchor="{anchor}" '
        f'fill="{INK}">{escape(text)}</text>'
    )


def _wire(x: int, y: int, to_x: int, to_y: int, colour: str, *, is_dashed: bool = False) -> str:
    dashes = ' stroke-dasharray="7 5"' if is_dashed else ""
    return f'<line x1="{x}" y1="{y}" x2="{to_x}" y2="{to_y}" stroke="{colour}" stroke-width="2.5"{dashes}/>'


def _twist(left: int, right: int, upper: int, lower: int) -> str:
    """Return two wires that cross a few times between `left` and `right`."""
    count = 5
    step = (right - left) // count
    paths = []
    for colour, first, other in ((PLUS, upper, lower), (MINUS, lower, upper)):
        path, levels = f"M{left} {first}", (other, first)
        for n in range(count - 1):
            x, y = left + step * (n + 1), levels[n % 2]
            before = levels[(n + 1) % 2]
            path += f" C{x - step // 2} {before} {x - step // 2} {y} {x} {y}"
        paths.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="2.5"/>')
    clear = (
        f'<rect x="{left}" y="{upper - 4}" width="{step * (count - 1)}" height="{lower - upper + 8}" '
        f'fill="{PAPER}"/>'
    )
    return clear + "".join(paths)
