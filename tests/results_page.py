"""Makes the tables of docs/results.md: `python -m tests.results_page`."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from gateway.contract import ResultCode
from gateway.contract.results import RESULTS

PAGE = Path(__file__).parents[1] / "docs" / "results.md"
BEGIN, END = "<!-- codes: made by python -m tests.results_page -->\n", "<!-- end of codes -->\n"


def tables() -> str:
    """Return the codes as Markdown."""
    parts = []
    for title, codes in groupby(RESULTS.items(), key=lambda each: each[1].group):
        rows = [f"| `{_shown(code)}` | {means.sentence} | {means.remedy} |" for code, means in codes]
        parts.append(
            "\n".join([f"### {title}", "", "| code | what it says | what to do |", "|---|---|---|", *rows])
        )
    return "\n\n".join(parts)


def _shown(code: str) -> str:
    return "exception_N" if code == ResultCode.EXCEPTION else code


def page(text: str) -> str:
    """Return the page with its tables made afresh."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{tables()}\n\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text("utf-8")), "utf-8")
