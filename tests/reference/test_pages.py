from __future__ import annotations

import pytest

from tests.reference.pages import FOLDER, NAMES, made, with_part


@pytest.mark.parametrize("name", NAMES)
def test_a_generated_page_is_what_the_program_says(name: str) -> None:
    assert (FOLDER / name).read_text("utf-8") == made(name)  # else: make docs


def test_a_page_without_its_marks_is_refused_rather_than_overwritten() -> None:
    with pytest.raises(ValueError, match="lost its mark"):
        with_part("# all by hand\n", "<!-- rows -->\n", "", "")
