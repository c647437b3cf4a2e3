"""A report for the terminal: 80 columns, aligned, plain text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap
from typing import assert_never

from gateway.cli.report.document import Block, FactTable, Pairs, Plots, ReportDocument, Texts

WIDTH = 80
LABEL_WIDTH = 32  # at most
NARROWEST = 12  # column of texts that is cut


def to_text(document: ReportDocument) -> str:
    """Return the report, each line at most 80 columns wide."""
    title = f"{document.title}: {document.starter}"
    lines = [
        title,
        "=" * len(title),
        document.subtitle,
        "",
        document.verdict + (":" if document.warnings else "."),
        *_texts(document.warnings),
    ]
    lines += ["", *_pairs(document.tiles.rows), ""]
    for section in document.sections:
        lines += [section.title, "-" * len(section.title)]
        for block in section.blocks:
            found = list(_block(block))
            lines += [*found, ""] if found else []
    return "\n".join(line.rstrip() for line in lines).rstrip() + "\n"


def _block(block: Block) -> Iterable[str]:
    match block:
        case Pairs(rows):
            return _pairs(rows)
        case FactTable():
            return _table(block)
        case Texts(texts):
            return _texts(texts)
        case Plots():
            return ()  # the tables have the numbers
        case _:
            assert_never(block)


def _texts(texts: Iterable[str]) -> Iterator[str]:
    for text in texts:
        yield from wrap(text, WIDTH - 2, initial_indent="  - ", subsequent_indent="    ")


def _pairs(pairs: Sequence[tuple[str, str]]) -> Iterator[str]:
    width = min(max((len(label) for label, _ in pairs), default=0), LABEL_WIDTH)
    for label, text in pairs:
        head = f"  {label:<{width}}  "
        yield from wrap(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head))


def _table(table: FactTable) -> Iterator[str]:
    """Yield the rows; the widest texts give way, then the last columns of numbers are left out."""
    rows, shown = [table.head, *table.rows], list(range(len(table.head)))
    widths = [max(len(row[at]) for row in rows) for at in shown]
    while sum(widths[at] + 2 for at in shown) > WIDTH:
        texts = [at for at in shown[1:] if at not in table.numbers and widths[at] > NARROWEST]
        if texts:
            widths[max(texts, key=lambda at: widths[at])] -= 1
        else:
            shown.remove(max(at for at in shown if at in table.numbers))
    for row in rows:
        sides = (">" if at in table.numbers else "<" for at in shown)
        yield "  " + "  ".join(
            _cell(row[at], widths[at], side) for at, side in zip(shown, sides, strict=True)
        )


def _cell(text: str, width: int, side: str) -> str:
    shown = text if len(text) <= width else f"{text[: width - 1]}…"
    return f"{shown:{side}{width}}"
