from __future__ import annotations

import pytest

from tests.reference.pages import FOLDER, pages

NAMES = [
    "reference/configuration.md",
    "reference/topics.md",
    "reference/asyncapi.yaml",
    "reference/events.md",
    "reference/commands.md",
]


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return pages()


def test_these_are_the_generated_pages(made: dict[str, str]) -> None:
    assert sorted(made) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_generated_page_is_what_the_program_says(made: dict[str, str], name: str) -> None:
    assert (FOLDER / name).read_text("utf-8") == made[name]  # else: make docs
