"""docs/metrics.md lists what there is."""

from __future__ import annotations

from gateway.plugins.metrics.catalogue import PREFIX
from tests.metrics_page import PAGE, page


def test_the_page_lists_every_metric() -> None:
    text = PAGE.read_text("utf-8")

    assert page(text) == text, "run `make docs`"


def test_the_page_names_the_prefix() -> None:
    assert PREFIX in PAGE.read_text("utf-8")
