from __future__ import annotations

import pytest

from tests import words


def found(text: str) -> list[str]:
    return [word for _, word in words.places(text)]


def test_no_file_has_one_of_the_words() -> None:
    assert words.found() == []


@pytest.mark.parametrize(
    "text",
    ["tell", "is_lock_told", "TELL_WITHIN_S", "_MENDS", "KeptWear", "isKept", "for\n    ever", "Taken over"],
)
def test_a_word_counts_in_names_texts_and_over_line_breaks(text: str) -> None:
    assert len(found(f"x = 1  # {text}\n")) == 1


@pytest.mark.parametrize(
    "text", ["turnaround_s", "TURNED_ON", "return", "untold", "intell", "`not_kept`", "the motor turns"]
)
def test_parts_of_other_words_codes_and_motors_do_not_count(text: str) -> None:
    assert found(text) == []
