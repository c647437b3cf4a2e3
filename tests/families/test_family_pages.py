"""The pages of the families say what the profiles say."""

from __future__ import annotations

import pytest

from gateway.families.profile.load import FAMILIES
from tests.family_pages import FOLDER, page_of


@pytest.mark.parametrize("family", FAMILIES)
def test_a_familys_page_agrees_with_its_profile(family: str) -> None:
    text = (FOLDER / f"{family}.md").read_text("utf-8")

    assert text == page_of(family, text), "run `make docs`"


def test_a_page_without_its_mark_is_refused_rather_than_overwritten() -> None:
    with pytest.raises(ValueError, match=r"ssw07\.md has lost its line"):
        page_of("ssw07", "# all by hand\n")
