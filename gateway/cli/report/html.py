"""A report as one HTML file with SVG plots: no script, nothing loaded, prints well on A4.

All text of a configuration, a starter or the broker passes `_e`, which escapes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import assert_never

from gateway.cli.report.document import Block, FactTable, Pairs, Plots, ReportDocument, Section, Texts

STYLE = Path(__file__).with_name("report.css")
BESIDE = 2  # the first sections share a row
_SAMPLE = '<svg viewBox="0 0 26 8"><path class="curve {kind}" d="M0 4h26"/></svg>'  # of a curve


def to_html(document: ReportDocument, *, language: str) -> str:
    """Return the report as a whole document."""
    title = f"{document.title} {document.starter}"
    tiles = (f"<div><b>{_e(value)}</b><span>{_e(label)}</span></div>" for label, value in document.tiles.rows)
    sections = [*map(_section, document.sections)]
    warn = " warn" if document.warnings else ""
    parts = (
        f"<header><h1><small>{_e(document.title)}</small>{_e(document.starter)}</h1>",
        f"<small>{_e(document.subtitle)}</small></header>",
        f'<div class="state{warn}"><b>{_e(document.verdict)}</b>{_list(document.warnings)}</div>',
        f'<div class="tiles">{"".join(tiles)}</div>',
        f'<div class="two">{"".join(sections[:BESIDE])}</div>',
        *sections[BESIDE:],
        "<footer>starter-gateway report</footer>",
    )
    return (
        f'<!DOCTYPE html>\n<html lang="{_e(language)}"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{_e(title)}</title>'
        f"<style>{STYLE.read_text('utf-8')}</style></head>\n<body>\n{chr(10).join(parts)}\n</body></html>\n"
    )


def _section(section: Section) -> str:
    return f"<section><h2>{_e(section.title)}</h2>{''.join(map(_block, section.blocks))}</section>"


def _block(block: Block) -> str:
    match block:
        case Pairs(rows):
            return f"<dl>{''.join(f'<dt>{_e(label)}</dt><dd>{_e(text)}</dd>' for label, text in rows)}</dl>"
        case FactTable():
            return _table(block)
        case Texts(texts):
            return _list(texts)
        case Plots():
            return _plots(block)
        case _:
            assert_never(block)


def _table(table: FactTable) -> str:
    def row(tag: str, texts: Sequence[str]) -> str:
        kinds = (' class="n"' if at in table.numbers else "" for at in range(len(texts)))
        cells = (f"<{tag}{kind}>{_e(text)}</{tag}>" for kind, text in zip(kinds, texts, strict=True))
        return f"<tr>{''.join(cells)}</tr>"

    body = "".join(row("td", texts) for texts in table.rows)
    return f"<table><thead>{row('th', table.head)}</thead><tbody>{body}</tbody></table>"


def _plots(block: Plots) -> str:
    kinds = {curve.kind for plot in block.rows for curve in plot.curves}
    legend = (_SAMPLE.format(kind=kind) + _e(word) for kind, word in block.legend.items() if kind in kinds)
    drawn = "".join(f"<div>{plot.svg()}</div>" for plot in block.rows)
    return f'<div class="plots">{drawn}</div><div class="legend">{"".join(legend)}</div>'


def _list(texts: Iterable[str]) -> str:
    items = "".join(f"<li>{_e(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""


def _e(text: str) -> str:
    return escape(text, quote=True)
