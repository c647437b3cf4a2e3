"""The generated pages and parts of pages, by their names below docs/."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gateway.families.profile.load import FAMILIES
from tests.reference import (
    catalogues,
    commands_page,
    configuration_page,
    contract_pages,
    family_pages,
    layers,
)

FOLDER = Path(__file__).parents[2] / "docs"
WHOLE: dict[str, Callable[[], str]] = {
    "reference/configuration.md": configuration_page.page,
    "reference/topics.md": contract_pages.topics_page,
    "reference/asyncapi.yaml": contract_pages.asyncapi,
    "reference/events.md": catalogues.events_page,
    "reference/commands.md": commands_page.page,
}
PARTS: dict[str, tuple[str, Callable[[], str]]] = {  # what the part is called in its marks
    "results.md": ("codes", catalogues.results),
    "metrics.md": ("metrics", catalogues.metrics),
    "architecture.md": ("layers", layers.tables),
}
BY_PROFILE = (
    "<!-- From here on generated from the profile by `make docs`; "
    "edit gateway/families/profiles instead. -->\n"
)
NAMES = (*WHOLE, *PARTS, *(f"families/{family}.md" for family in FAMILIES))


def made(name: str) -> str:
    """Return the text of a page; ValueError where a part's marks are lost."""
    if name in WHOLE:
        return WHOLE[name]()
    text = (FOLDER / name).read_text("utf-8")
    if name not in PARTS:
        return with_part(text, BY_PROFILE, "", family_pages.tables(Path(name).stem))
    part, tables = PARTS[name]
    begin, end = f"<!-- {part}: made by `make docs` -->\n", f"<!-- end of {part} -->\n"
    return with_part(text, begin, end, f"{tables()}\n")


def with_part(text: str, begin: str, end: str, made: str) -> str:
    """Return a page with its generated part made again: that between the marks, or to the page's end."""
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end) if end else ("", "all of it", "")
    if not found or not closed:
        raise ValueError(f"a page has lost its mark {begin!r} or {end!r}")
    return f"{before}{begin}\n{made}{end}{after}"
