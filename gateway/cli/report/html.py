"""A health report as one HTML file with SVG plots: no script, nothing loaded, prints well on A4.

Whatever comes from a configuration, a starter or the broker passes `_e`, which escapes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from gateway.cli.report import facts
from gateway.cli.report.content import TRENDS, HealthReport
from gateway.cli.report.facts import TextTable
from gateway.cli.report.labels import Translate
from gateway.cli.report.plots import DARK, EARLIER, LATEST, Plot, PlotLine
from gateway.plugins.history.baseline import LIMIT_PCT

_STYLE = """
@page { size: A4; margin: 11mm 14mm; }
* { box-sizing: border-box; }
body { font: 13px/1.45 "Helvetica Neue", Helvetica, Arial, "Liberation Sans", sans-serif; color: #1b2a3a;
  max-width: 182mm; margin: 10mm auto; padding: 0 4mm; }
header { display: flex; justify-content: space-between; align-items: flex-end;
  border-bottom: 3px solid #1b2a3a; padding-bottom: 6px; }
header small { color: #5b6b7b; }
h1 { font-size: 26px; line-height: 1.1; margin: 0; }
h1 small { display: block; font-size: 12px; font-weight: 600; letter-spacing: .08em;
  text-transform: uppercase; }
h2 { font-size: 14px; margin: 14px 0 5px; padding-bottom: 2px; border-bottom: 1px solid #c3ccd6;
  break-after: avoid; }
.state { margin: 12px 0; padding: 8px 12px; border-left: 5px solid #2e7d4f; background: #eef7f1; }
.state.warn { border-color: #c2410c; background: #fdf1ea; }
.state ul { margin: 2px 0 0; padding-left: 18px; }
.tiles { display: grid; grid-template-columns: repeat(4, 1fr); gap: 10px; }
.tiles div { border: 1px solid #c3ccd6; border-radius: 4px; padding: 7px 10px; }
.tiles b { display: block; font-size: 19px; line-height: 1.25; white-space: nowrap; }
.tiles span { color: #5b6b7b; font-size: 11px; }
.two { display: grid; grid-template-columns: 1fr 1fr; gap: 0 24px; }
.plots { display: grid; grid-template-columns: 1fr 1fr; gap: 4px 20px; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 2px 14px; margin: 0; }
dt { color: #5b6b7b; } dd { margin: 0; }
svg { display: block; width: 100%; height: auto; } svg text { font-size: 9px; fill: #3c4a58; }
.legend { font-size: 11px; color: #3c4a58; margin: 2px 0 6px; }
.legend i { display: inline-block; width: 22px; height: 0; border-top: 2px solid; vertical-align: middle;
  margin: 0 5px 0 12px; }
table { border-collapse: collapse; width: 100%; font-size: 12px; }
th { text-align: left; font-weight: 600; color: #5b6b7b; border-bottom: 1px solid #1b2a3a; }
th, td { padding: 2.5px 16px 2.5px 0; vertical-align: top; }
td { border-bottom: 1px solid #e6ebf0; } .n { text-align: right; font-variant-numeric: tabular-nums; }
.keep, tr, .plots > div { break-inside: avoid; } .legend { break-before: avoid; }
footer { margin-top: 18px; color: #5b6b7b; font-size: 11px; border-top: 1px solid #c3ccd6; padding-top: 4px; }
@media print { body { margin: 0; padding: 0; max-width: none; font-size: 11.5px; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""
_WIDE, _NARROW = (560.0, 142.0), (270.0, 96.0)


def to_html(report: HealthReport, t: Translate, *, language: str) -> str:
    """Return the report as a whole document."""
    title = f"{t('Health report')} {report.starter}"
    parts = [
        _head(report, t),
        _state(facts.attention(report, t), t),
        _tiles(report, t),
        f'<div class="two">{_block(t("Identity"), _pairs(report.identity.items()))}'
        f"{_block(t('Life'), _pairs(_beside_tiles(report, t)))}</div>",
        _curves(report, t),
        _trends(report, t),
        _block(t("Starts"), _table(facts.starts(report, t), t), is_whole=False),
        _block(t("Trips"), _table(facts.trips(report, t), t)),
        _block(t("Changed parameters"), _table(facts.settings(report, t), t)),
        _line(report, t),
        _block(t("Notes"), _list(report.notes)) if report.notes else "",
        f"<footer>starter-gateway report · {_e(facts.moment(report.made))} UTC</footer>",
    ]
    return (
        f'<!DOCTYPE html>\n<html lang="{_e(language)}"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{_e(title)}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n{chr(10).join(filter(None, parts))}\n</body></html>\n"
    )


def _head(report: HealthReport, t: Translate) -> str:
    made = f"{t('gateway')} {report.gateway} · {facts.moment(report.made)} UTC"
    name = f"<h1><small>{_e(t('Health report'))}</small>{_e(report.starter)}</h1>"
    return f"<header>{name}<small>{_e(made)}</small></header>"


def _state(warnings: Sequence[str], t: Translate) -> str:
    if not warnings:
        return f'<div class="state"><b>{_e(t("Nothing unusual"))}</b></div>'
    return f'<div class="state warn keep"><b>{_e(t("Attention"))}</b>{_list(warnings)}</div>'


def _tiles(report: HealthReport, t: Translate) -> str:
    shown = dict(facts.life(report, t))
    changes = {row[0]: row[-1] for row in facts.comparison(report, t).rows}
    name = facts.quantity("acceleration_s", t)
    tiles = [
        (t("operating hours"), shown[t("operating hours")]),
        (t("starts"), shown[t("starts")]),
        (t("trips"), str(report.totals.trips.total())),
        (name, changes[name]),
    ]
    cells = (f"<div><b>{_e(value)}</b><span>{_e(label)}</span></div>" for label, value in tiles)
    return f'<div class="tiles">{"".join(cells)}</div>'


def _beside_tiles(report: HealthReport, t: Translate) -> list[tuple[str, str]]:
    return [pair for pair in facts.life(report, t) if pair[0] not in (t("operating hours"), t("starts"))]


def _curves(report: HealthReport, t: Translate) -> str:
    earlier = report.curves[:-1]
    latest = report.curves[-1] if report.curves else None
    if latest is None and report.baseline_curve is None:
        return _block(t("Start curves"), f"<p>{_e(t('none recorded'))}</p>")
    usual = report.baseline_curve
    drawn = [
        PlotLine(facts.current_of(curve), EARLIER, 0.8, opacity=0.25 + 0.5 * number / max(len(earlier), 1))
        for number, curve in enumerate(earlier)
    ]
    drawn += [] if latest is None else [PlotLine(facts.current_of(latest), LATEST, 1.8)]
    drawn += [] if usual is None else [PlotLine(facts.current_of(usual), DARK, 1.5, "5 3")]
    drawn = [each for each in drawn if len(each.points) > 1]
    plot = Plot(*_WIDE, f"{t('time')} s", f"{t('current')} A", drawn)
    keys = [(DARK, "dashed", t("baseline")), (LATEST, "solid", t("latest")), (EARLIER, "solid", t("earlier"))]
    legend = "".join(f'<i style="border-top:2px {line} {c}"></i>{_e(word)}' for c, line, word in keys)
    table = _table(facts.comparison(report, t), t)
    return _block(t("Start curves"), f'{plot.svg()}<div class="legend">{legend}</div>{table}')


def _trends(report: HealthReport, t: Translate) -> str:
    months = report.months[-18:]
    if not months:
        return ""
    names = [month.month[2:] for month in months]
    plots = []
    for quantity in TRENDS:
        unit, size = facts.UNITS[quantity]
        means = [(float(at), month.mean(quantity)) for at, month in enumerate(months)]
        points = [(at, mean / size) for at, mean in means if mean is not None]
        typical = report.typical(quantity)
        usual = None if typical is None else typical / size
        share = LIMIT_PCT / 100
        plots.append(
            Plot(
                *_NARROW,
                "",
                f"{facts.quantity(quantity, t)}, {unit}",
                [PlotLine(points, LATEST, 1.4, has_marks=True)] if points else [],
                names=names,
                from_zero=False,
                level=usual,
                band=None if usual is None else (usual * (1 - share), usual * (1 + share)),
            )
        )
    plots.append(Plot(*_NARROW, "", t("Starts"), columns=[float(m.starts) for m in months], names=names))
    drawn = "".join(f"<div>{plot.svg()}</div>" for plot in plots)
    key = _e(t("dashed: baseline, shaded: within 15 % of it")) if report.baseline is not None else ""
    inner = f'<div class="plots">{drawn}</div><div class="legend">{key}</div>'
    return _block(t("Trends by month"), inner, is_whole=False)


def _line(report: HealthReport, t: Translate) -> str:
    if report.line is None:
        return ""
    texts = f'<div class="state warn">{_list(report.line.texts)}</div>' if report.line.texts else ""
    return _block(f"{t('Line')} {report.line.line}", _pairs(facts.line(report, t)) + texts)


def _block(title: str, inner: str, *, is_whole: bool = True) -> str:
    """Return a section; one that is whole is not cut by the end of a page."""
    kind = ' class="keep"' if is_whole else ""
    return f"<section{kind}><h2>{_e(title)}</h2>{inner}</section>"


def _pairs(pairs: Iterable[tuple[str, str]]) -> str:
    return f"<dl>{''.join(f'<dt>{_e(label)}</dt><dd>{_e(text)}</dd>' for label, text in pairs)}</dl>"


def _list(texts: Iterable[str]) -> str:
    return f"<ul>{''.join(f'<li>{_e(text)}</li>' for text in texts)}</ul>"


def _table(table: TextTable, t: Translate) -> str:
    if not table.rows:
        return f"<p>{_e(t('none recorded'))}</p>"

    def cells(tag: str, row: Sequence[str]) -> str:
        kinds = (' class="n"' if at in table.numbers else "" for at in range(len(row)))
        return "".join(f"<{tag}{kind}>{_e(text)}</{tag}>" for kind, text in zip(kinds, row, strict=True))

    rows = "".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
    return f"<table><thead><tr>{cells('th', table.head)}</tr></thead><tbody>{rows}</tbody></table>"


def _e(text: str) -> str:
    return escape(text, quote=True)
