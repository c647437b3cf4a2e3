"""A report for the terminal: 80 columns, aligned, plain text."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import wrap

from gateway.cli.report.document import FactTable, ReportDocument

WIDTH = 80
LABEL_WIDTH = 32  # at most
NARROWEST = 12  # column of texts that is cut


def to_text(document: ReportDocument) -> str:
    """Return the report, each line at most 80 columns wide."""
    title = f"{document.title}: {document.starter}"
    verdict = document.verdict + (":" if document.warnings.rows else ".")
    lines = [title, "=" * len(title), document.subtitle, "", verdict, *_facts(document.warnings)]
    lines += [""]
    for section in document.sections:
        lines += [section.title, "-" * len(section.title)]
        for table in section.tables:
            found = list(_columns(table) if table.head else _facts(table))
            lines += [*found, ""] if found else []
    return "\n".join(line.rstrip() for line in lines).rstrip() + "\n"


def _facts(table: FactTable) -> Iterator[str]:
    """Yield each fact behind its label, or each sentence, on as many lines as it needs."""
    width = min(max((len(row[0]) for row in table.rows if len(row) > 1), default=0), LABEL_WIDTH)
    for *label, text in table.rows:
        head = f"  {label[0]:<{width}}  " if label else "  - "
        yield from wrap(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head))


def _columns(table: FactTable) -> Iterator[str]:
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
        yield "  " + "  ".join(_cell(row[at], widths[at], is_number=at in table.numbers) for at in shown)


def _cell(text: str, width: int, *, is_number: bool) -> str:
    shown = text if len(text) <= width else f"{text[: width - 1]}…"
    return shown.rjust(width) if is_number else shown.ljust(width)
