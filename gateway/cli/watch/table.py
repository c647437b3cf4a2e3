"""An overview as lines of `rich`: one of each starter, and another one for a text that does not fit there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from textwrap import wrap

from rich.cells import cell_len
from rich.console import Group
from rich.text import Text

from gateway.cli.command import counted, in_words
from gateway.cli.watch.overview import SIGNALS, GatewayRecords, Overview, StarterRow
from gateway.contract import Quality, ValueRecord, shortened

COLUMNS = ("", "starter", "state", "current", "last reply")
TITLE, LEAST_TITLE = 1, 12  # the column that is cut where a line is too long, and to how many at most
RIGHT = range(3, 5)  # columns of numbers
STYLES = dict(zip(SIGNALS, ("bold white on red", "black on dark_orange", "black on yellow", ""), strict=True))
GREY = "bright_black"  # what is not known to be so now
INDENT = "     "  # of a second line


def render(overview: Overview, now_s: float, width: int) -> Group:
    """Return the lines at `now_s` (seconds since 1970); a terminal shows their beginning."""
    rows, gateways = overview.rows(), overview.gateways()
    heads = [_head(gateway, now_s, [row for row in rows if row.gateway is gateway]) for gateway in gateways]
    cells = [[Text(title, style="bold underline") for title in COLUMNS]]
    cells += [_cells(row, now_s, has_gateway=len(gateways) > 1) for row in rows]
    widths = [max(cell.cell_len for cell in column) for column in zip(*cells, strict=True)]
    too_long = sum(widths) + 2 * (len(widths) - 1) - width
    widths[TITLE] -= max(min(too_long, widths[TITLE] - LEAST_TITLE), 0)
    texts = ["", *("; ".join(row.texts()) for row in rows)]
    lines = [line for pair in zip(cells, texts, strict=True) for line in _lines(*pair, widths, width)]
    return Group(*(heads or [Text("no gateway has published anything here yet", style=GREY)]), *lines)


def _lines(cells: Sequence[Text], text: str, widths: Sequence[int], width: int) -> Iterator[Text]:
    """Yield the line of a starter, and where its text does not fit behind it that on lines of its own."""
    for column, cell in enumerate(cells):
        cell.truncate(widths[column], overflow="ellipsis")
        pad = cell.pad_left if column in RIGHT else cell.pad_right
        pad(widths[column] - cell.cell_len)
    line, text = Text("  ").join(cells), shortened(text, 500)
    if line.cell_len + 2 + cell_len(text) <= width:
        yield line.append(f"  {text}" if text else "")
    else:
        yield line
        yield from (Text(part) for part in wrap(text, width, initial_indent=INDENT, subsequent_indent=INDENT))


def _head(gateway: GatewayRecords, now_s: float, rows: list[StarterRow]) -> Text:
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
    ]


def _number(value: ValueRecord | None) -> Text:
    """Return a current with its unit, or a load; the empty text where there is none."""
    if value is None or isinstance(value.value, bool | str | None):
        return Text("")
    digits = 0 if value.unit == "%" else 1
    text = f"{value.value:.{digits}f} {shortened(value.unit)}"
    return Text(text, style="" if value.quality is Quality.GOOD else GREY)
