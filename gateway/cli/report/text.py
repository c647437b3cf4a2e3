"""A health report for the terminal: 80 columns, aligned, plain text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap

from gateway.cli.report import facts
from gateway.cli.report.content import TRENDS, HealthReport
from gateway.cli.report.facts import TextTable
from gateway.cli.report.labels import Translate

WIDTH = 80
_BARS = " ▁▂▃▄▅▆▇█"
_CURVE_ROWS, _CURVE_COLUMNS = 8, 62


def to_text(report: HealthReport, t: Translate) -> str:
    """Return the report, each line at most 80 columns wide."""
    title = f"{t('Health report')}: {report.starter}"
    made = f"{t('gateway')} {report.gateway}, {t('made')} {facts.moment(report.made)} UTC"
    parts = [title, "=" * len(title), made, ""]
    warnings = facts.attention(report, t)
    parts += _bullets(f"! {t('Attention')}", warnings) if warnings else [t("Nothing unusual") + ".", ""]
    parts += _section(t("Identity"), _pairs(report.identity.items()))
    parts += _section(t("Life"), _pairs(facts.life(report, t)))
    parts += _section(t("Starts"), _starts(report, t))
    parts += _section(t("Trends by month"), _months(report, t))
    parts += _section(t("Trips"), _table(facts.trips(report, t)) or [t("none recorded")])
    settings = _table(facts.settings(report, t)) or [t("none recorded")]
    parts += _section(t("Changed parameters"), settings)
    if report.line is not None:
        texts = [line for text in report.line.texts for line in _folded(f"! {text}")]
        parts += _section(f"{t('Line')} {report.line.line}", [*_pairs(facts.line(report, t)), *texts])
    if report.notes:
        parts += _bullets(t("Notes"), report.notes)
    return "\n".join(line.rstrip() for line in parts).rstrip() + "\n"


def _starts(report: HealthReport, t: Translate) -> Iterator[str]:
    if not report.starts:
        yield t("none recorded")
        return
    yield from _table(facts.comparison(report, t))
    yield ""
    yield from _curve(report, t)
    yield from _table(facts.starts(report, t))


def _curve(report: HealthReport, t: Translate) -> Iterator[str]:
    latest = report.curves[-1] if report.curves else None
    drawn = [(curve, mark) for curve, mark in ((report.baseline_curve, "."), (latest, "#")) if curve]
    points = [(*point, mark) for curve, mark in drawn for point in facts.current_of(curve)]
    if len(points) < 2:
        return
    last_s, most = max(t_s for t_s, _, _ in points), max(current for _, current, _ in points) or 1.0
    first_s = min(t_s for t_s, _, _ in points)
    grid = [[" "] * _CURVE_COLUMNS for _ in range(_CURVE_ROWS)]
    for t_s, current, mark in points:
        column = round((t_s - first_s) / max(last_s - first_s, 1e-9) * (_CURVE_COLUMNS - 1))
        grid[_CURVE_ROWS - 1 - round(max(current, 0.0) / most * (_CURVE_ROWS - 1))][column] = mark
    yield f"{'':>12}# {t('latest')}" + (f"   . {t('baseline')}" if len(drawn) > 1 else "")
    for number, row in enumerate(grid):
        label = facts.number(most, "A") if number == 0 else "0 A" if number == _CURVE_ROWS - 1 else ""
        yield f"{label:>10} |{''.join(row)}"
    end = f"{last_s:.1f} s"
    yield f"{'':>10} +{'-' * _CURVE_COLUMNS}"
    yield f"{'':>12}{f'{first_s:.1f} s':<{_CURVE_COLUMNS - len(end)}}{end}"
    yield ""


def _months(report: HealthReport, t: Translate) -> list[str]:
    if not report.months:
        return [t("none recorded")]
    found = _table(facts.months(report, t))
    shown = report.months[-facts.MOST_MONTHS :]
    bars = [(facts.quantity(name, t), _spark([month.mean(name) for month in shown])) for name in TRENDS]
    return [*found, "", *_pairs(bars)]


def _spark(values: Sequence[float | None]) -> str:
    most = max((value for value in values if value is not None), default=0.0)
    if most <= 0:
        return ""
    return "".join(" " if value is None else _BARS[max(round(value / most * 8), 1)] for value in values)


def _section(title: str, lines: Iterable[str]) -> list[str]:
    return [title, "-" * len(title), *lines, ""]


def _bullets(title: str, texts: Iterable[str]) -> list[str]:
    return [title, *(line for text in texts for line in _folded(f"- {text}")), ""]


def _folded(text: str) -> list[str]:
    return wrap(text, WIDTH - 2, initial_indent="  ", subsequent_indent="    ")


def _pairs(pairs: Iterable[tuple[str, str]]) -> list[str]:
    pairs = list(pairs)
    width = min(max((len(label) for label, _ in pairs), default=0), 32)
    found = []
    for label, text in pairs:
        lines = wrap(text, WIDTH - width - 4) or [""]
        found.append(f"  {label:<{width}}  {lines[0]}")
        found += [f"  {'':<{width}}  {line}" for line in lines[1:]]
    return found


def _table(table: TextTable) -> list[str]:
    if not table.rows:
        return []
    rows = [table.head, *table.rows]
    widths = [max(len(row[at]) for row in rows) for at in range(len(table.head))]
    texts = [at for at in range(1, len(widths)) if at not in table.numbers]
    room = WIDTH - 2 - 2 * (len(widths) - 1)
    while sum(widths) > room and texts:
        widest = max(texts, key=lambda at: widths[at])
        widths[widest] -= 1
    return [
        "  " + "  ".join(_cell(row[at], width, at in table.numbers) for at, width in enumerate(widths))
        for row in rows
    ]


def _cell(text: str, width: int, is_number: bool) -> str:  # noqa: FBT001 - a cell's alignment
    shown = text if len(text) <= width else f"{text[: width - 1]}…"
    return f"{shown:>{width}}" if is_number else f"{shown:<{width}}"
