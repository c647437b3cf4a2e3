"""Makes the tables of docs/metrics.md from the catalogue: run it with `python -m`."""

from __future__ import annotations

from pathlib import Path

from gateway.plugins.metrics.catalogue import METRICS, MetricSpec

PAGE = Path(__file__).parents[1] / "docs" / "metrics.md"
BEGIN, END = "<!-- metrics: made by python -m tests.metrics_page -->\n", "<!-- end of metrics -->\n"


def tables() -> str:
    """Return a table for each group of metrics."""
    parts = []
    for group, metrics in METRICS.items():
        rows = [_row(name, spec) for name, spec in metrics.items()]
        parts.append(
            "\n".join([f"### {group}\n", "| metric | type | labels | meaning |", "|---|---|---|---|", *rows])
        )
    return "\n\n".join(parts) + "\n"


def page(text: str) -> str:
    """Return the page with its tables made again."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{tables()}\n{END}{after}"


def _row(name: str, spec: MetricSpec) -> str:
    labels = ", ".join(f"`{label}`" for label in spec.labels)
    return f"| `{name}` | {spec.kind} | {labels} | {spec.help} |"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text("utf-8")), "utf-8")
