"""A report as one HTML file with SVG plots: no script, nothing loaded, prints well on A4.

All text of a configuration, a starter or the broker passes `_e`, which escapes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from gateway.cli.report.document import FactTable, ReportDocument, Section

STYLE = Path(__file__).with_name("report.css")
BESIDE = 2  # the first sections share a row
_SAMPLE = '<svg viewBox="0 0 26 8"><path class="curve {kind}" d="M0 4h26"/></svg>'  # of a curve


def to_html(document: ReportDocument, *, language: str) -> str:
    """Return the report as a whole document."""
    title = f"{document.title} {document.starter}"
    sections = [_section(section, document.legend) for section in document.sections]
    warn = " warn" if document.warnings.rows else ""
    parts = (
        f"<header><h1><small>{_e(document.title)}</small>{_e(document.starter)}</h1>",
        f"<small>{_e(document.subtitle)}</small></header>",
        f'<div class="state{warn}"><b>{_e(document.verdict)}</b>{_table(document.warnings)}</div>',
        f'<div class="two">{"".join(sections[:BESIDE])}</div>',
        *sections[BESIDE:],
        "<footer>starter-gateway report</footer>",
    )
    return (
        f'<!DOCTYPE html>\n<html lang="{_e(language)}"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{_e(title)}</title>'
        f"<style>{STYLE.read_text('utf-8')}</style></head>\n<body>\n{chr(10).join(parts)}\n</body></html>\n"
    )


def _section(section: Section, legend: Mapping[str, str]) -> str:
    kinds = {curve.kind for plot in section.plots for curve in plot.curves}
    said = (_SAMPLE.format(kind=kind) + _e(word) for kind, word in legend.items() if kind in kinds)
    drawn = "".join(f"<div>{plot.svg()}</div>" for plot in section.plots)
    plots = f'<div class="plots">{drawn}</div><div class="legend">{"".join(said)}</div>' if drawn else ""
    tables = "".join(map(_table, section.tables))
    return f"<section><h2>{_e(section.title)}</h2>{plots}{tables}</section>"


def _table(table: FactTable) -> str:
    def row(tag: str, texts: Sequence[str]) -> str:
        kinds = (' class="n"' if at in table.numbers else "" for at in range(len(texts)))
        cells = (f"<{tag}{kind}>{_e(text)}</{tag}>" for kind, text in zip(kinds, texts, strict=True))
        return f"<tr>{''.join(cells)}</tr>"

    if not table.rows:
        return ""
    body = "".join(row("td", texts) for texts in table.rows)
    if not table.head:
        return f'<table class="facts"><tbody>{body}</tbody></table>'
    return f"<table><thead>{row('th', table.head)}</thead><tbody>{body}</tbody></table>"


def _e(text: str) -> str:
    return escape(text, quote=True)
