"""An overview as a table of `rich`, at 80 columns too."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table
from rich.text import Text

from gateway.cli.command import counted, in_words
from gateway.cli.watch.overview import SIGNALS, GatewayLine, Overview, StarterRow
from gateway.contract import Quality, ValueRecord, shortened

COLUMNS = ("", "starter", "state", "current", "last reply", "fault, reason, command")
STYLES = dict(zip(SIGNALS, ("bold white on red", "black on dark_orange", "black on yellow", ""), strict=True))
GREY = "bright_black"  # what is not known to be so now


def render(overview: Overview, now_s: float) -> Group:
    """Return the table at `now_s` (seconds since 1970); a terminal shows its beginning."""
    rows, gateways = overview.rows(), [gateway for _, gateway in sorted(overview.gateways.items())]
    heads = [_head(gateway, now_s, [row for row in rows if row.gateway is gateway]) for gateway in gateways]
    table = Table(*COLUMNS[:-1], box=None, expand=True, pad_edge=False, header_style="bold underline")
    for column in table.columns:
        column.no_wrap, column.min_width = True, 9 if column.header else 1
        column.justify = "right" if column.header in ("current", "last reply") else "left"
    table.add_column(COLUMNS[-1], ratio=1, overflow="fold")
    for row in rows:
        name = row.title or row.name
        name = name if len(gateways) == 1 else f"{row.gateway.name} {name}"
        table.add_row(*_cells(row, name, now_s), style="" if row.gateway.is_live(now_s) else GREY)
    return Group(*(heads or [Text("no gateway has published anything here yet", style=GREY)]), table)


def _head(gateway: GatewayLine, now_s: float, rows: list[StarterRow]) -> Text:
    status, failures = gateway.status, sum(row.signal == "F" for row in rows)
    state = "unknown" if status is None else status.state
    reason = f" ({status.reason})" if status is not None and status.reason else ""
    head = Text.assemble((shortened(gateway.name, 80), "bold"), f"  {state}{shortened(reason, 80)}")
    if gateway.is_live(now_s):
        failed = f", {failures} with a fault or offline" if failures else ""
        return head.append(f"  LIVE  {counted(len(rows), 'starter')}{failed}")
    since = "since this table began"
    if gateway.live_at_s is not None:
        since = f"for {in_words(now_s - gateway.live_at_s)}"
    return head.append(f"  NOT LIVE {since}", style=STYLES["F"])


def _cells(row: StarterRow, name: str, now_s: float) -> list[Text]:
    silent_s, style = row.silent_s(now_s), "" if row.is_good else GREY
    current, load = (_number(row.value.get(point)) for point in ("current", "current_pct"))
    return [
        Text(row.signal, style=STYLES[row.signal]),
        _text(name, "bold"),
        _text(row.state.state.replace("_", " ") + ("" if row.is_good else "?"), style),
        Text(" ").join([current, load]) if load else current,
        Text("never" if silent_s is None else "now" if silent_s == 0 else in_words(silent_s), style=style),
        _text("; ".join([*row.troubles(), *row.commanded()])),
    ]


def _number(value: ValueRecord | None) -> Text:
    """Return a current with its unit, or a load; the empty text where there is none."""
    if value is None or isinstance(value.value, bool | str | None):
        return Text("")
    digits = 0 if value.unit == "%" else 1
    text = f"{value.value:.{digits}f} {shortened(value.unit)}"
    return Text(text, style="" if value.quality is Quality.GOOD else GREY)


def _text(text: str, style: str = "") -> Text:
    """Return somebody else's text, fit for a terminal."""
    return Text(shortened(text, 200), style=style)
