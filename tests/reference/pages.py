"""The generated pages, by their names below docs/."""

from __future__ import annotations

from pathlib import Path

from tests.reference import commands_page, configuration_page, contract_pages, events_page

FOLDER = Path(__file__).parents[2] / "docs"


def pages() -> dict[str, str]:
    """Return the text of each generated page."""
    return {
        "reference/configuration.md": configuration_page.page(),
        "reference/topics.md": contract_pages.topics_page(),
        "reference/asyncapi.yaml": contract_pages.asyncapi(),
        "reference/events.md": events_page.page(),
        "reference/commands.md": commands_page.page(),
    }
