"""An overview as a table of `rich`: a row for each starter, a line above for each gateway."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table
from rich.text import Text

from gateway.cli.command import counted, in_words
from gateway.cli.watch.overview import SIGNALS, GatewayLine, Overview, StarterRow
from gateway.contract import Quality, ValueRecord, shortened

STYLES = dict(zip(SIGNALS, ("bold white on red", "black on dark_orange", "black on yellow", ""), strict=True))
GREY = "bright_black"  # what is not known to be so now


def render(overview: Overview, now_s: float, width: int) -> Group:
    """Return what is so at `now_s` (seconds since 1970), `width` columns wide; a terminal cuts its end."""
    rows, gateways = overview.rows(), [gateway for _, gateway in sorted(overview.gateways.items())]
    heads = [_head(gateway, now_s, [row for row in rows if row.gateway is gateway]) for gateway in gateways]
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="bold underline")
    table.add_column("", no_wrap=True)
    table.add_column("starter", no_wrap=True, max_width=width // 4)
    table.add_column("state", no_wrap=True)
    table.add_column("current", no_wrap=True, justify="right")
    table.add_column("reply", no_wrap=True, justify="right")
    table.add_column("", overflow="fold")
    for row in rows:
        table.add_row(*_cells(row, now_s, has_gateway=len(gateways) > 1))
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


def _cells(row: StarterRow, now_s: float, *, has_gateway: bool) -> list[Text]:
    silent_s, style = row.silent_s(now_s), "" if row.is_good and row.gateway.is_live(now_s) else GREY
    name = f"{row.gateway.name} {row.title}" if has_gateway else row.title
    current, load = (_number(row.value(point)) for point in ("current", "current_pct"))
    return [
        Text(row.signal, style=STYLES[row.signal]),
        Text(shortened(name, 80), style=f"bold {style}".strip()),
        Text(row.state.state.replace("_", " ") + ("" if row.is_good else "?"), style=style),
        Text(" ").join([current, load]) if load else current,
        Text("never" if silent_s is None else "now" if silent_s == 0 else in_words(silent_s), style=style),
        Text(shortened("; ".join(row.texts()), 500)),
    ]


def _number(value: ValueRecord | None) -> Text:
    """Return a current with its unit, or a load; the empty text where there is none."""
    if value is None or isinstance(value.value, bool | str | None):
        return Text("")
    digits = 0 if value.unit == "%" else 1
    text = f"{value.value:.{digits}f} {shortened(value.unit)}"
    return Text(text, style="" if value.quality is Quality.GOOD else GREY)
