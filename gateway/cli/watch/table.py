"""An overview as a table of `rich`."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table
from rich.text import Text

from gateway.cli.command import in_words
from gateway.cli.watch.overview import CURRENT, CURRENT_PCT, Overview, ShownValue, Signal, StarterRow

BAR_WIDTH = 10  # of the current against the rated one
HEADER_LINES = 4  # of the table, beside the gateways and the remainder

_STYLES = {  # colour only for what is not normal, and never colour alone
    Signal.FAILURE: "bold white on red",
    Signal.CHECK: "black on dark_orange",
    Signal.OUT_OF_SPEC: "black on yellow",
    Signal.MAINTENANCE: "white on blue",
    Signal.NONE: "",
}
_GREY = "bright_black"
_EIGHTHS = " ▏▎▍▌▋▊▉█"


def render(overview: Overview, now_s: float, *, height: int | None = None) -> Group:
    """Return everything that fits into so many lines (None: all), at `now_s` (seconds since 1970)."""
    rows = overview.rows()
    heads = [_head(overview, name, now_s) for name in sorted(overview.gateways)]
    if not heads:
        heads = [Text("no gateway has published anything here yet", style=_GREY)]
    shown = rows if height is None else rows[: max(height - len(heads) - HEADER_LINES - 1, 1)]
    parts: list[Text | Table] = [*heads, _table(overview, shown, now_s)]
    if len(shown) < len(rows):
        parts.append(Text(f"... and {len(rows) - len(shown)} more starters", style=_GREY))
    return Group(*parts)


def _head(overview: Overview, name: str, now_s: float) -> Text:
    gateway = overview.gateways[name]
    text = Text.assemble((name, "bold"), f"  {gateway.state}")
    if gateway.reason:
        text.append(f" ({gateway.reason})")
    if gateway.is_live(now_s):
        return text.append("  LIVE")
    if gateway.live_at_s is None:
        return text.append("  NOT LIVE: no sign of it since this table began", style=_STYLES[Signal.FAILURE])
    since = in_words(now_s - gateway.live_at_s)
    return text.append(f"  NOT LIVE for {since}", style=_STYLES[Signal.FAILURE])


def _table(overview: Overview, rows: list[StarterRow], now_s: float) -> Table:
    table = Table(expand=True)
    is_one = len({row.gateway for row in rows}) <= 1
    table.add_column("", width=1)
    if not is_one:
        table.add_column("gateway", no_wrap=True)
    for title in ("starter", "state"):
        table.add_column(title, no_wrap=True)
    table.add_column("current", justify="right", no_wrap=True)
    table.add_column("of rated", no_wrap=True, width=BAR_WIDTH + 6)
    table.add_column("fault, alarm, reason", ratio=3, overflow="ellipsis", no_wrap=True)
    table.add_column("age", justify="right", no_wrap=True)
    table.add_column("last command", ratio=2, overflow="ellipsis", no_wrap=True)
    for row in rows:
        cells = _cells(overview, row, now_s)
        if not is_one:
            cells.insert(1, Text(row.gateway))
        table.add_row(*cells, style="" if overview.is_live(row, now_s) else _GREY)
    return table


def _cells(overview: Overview, row: StarterRow, now_s: float) -> list[Text]:
    age_s = overview.age_s(row, now_s)
    state_style = "" if row.is_good else _GREY
    return [
        Text(row.signal, style=_STYLES[row.signal]),
        Text(row.name, style="bold"),
        Text(row.state if row.is_good else f"{row.state}?", style=state_style),
        _number(row.readings.get(CURRENT)),
        _bar(row.readings.get(CURRENT_PCT)),
        Text(row.trouble),
        Text("never" if age_s is None else in_words(age_s), style=state_style),
        Text(row.command),
    ]


def _number(reading: ShownValue | None) -> Text:
    if reading is None:
        return Text("-", style=_GREY)
    return Text(f"{reading.value:.1f} {reading.unit}", style="" if reading.is_good else _GREY)


def _bar(reading: ShownValue | None) -> Text:
    if reading is None:
        return Text("")
    eighths = round(min(max(reading.value, 0.0), 100.0) / 100 * BAR_WIDTH * 8)
    bar = _EIGHTHS[8] * (eighths // 8) + (_EIGHTHS[eighths % 8] if eighths % 8 else "")
    return Text(f"{bar:<{BAR_WIDTH}} {reading.value:4.0f}%", style="" if reading.is_good else _GREY)
