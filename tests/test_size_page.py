"""What docs/size.md says has been reached stays reached."""

from __future__ import annotations

from tests import size_page


def test_no_folder_has_more_than_13_modules() -> None:
    assert size_page.largest_folder()[0] <= 13


def test_fewer_than_30_files_are_below_60_lines() -> None:
    assert len(size_page.small_files()) < 30


def test_no_class_name_exists_twice() -> None:
    assert size_page.double_names() == []


def test_a_scheduled_poll_has_at_most_8_fields() -> None:
    fields = size_page.poll_fields()

    assert "poll" in fields
    assert len(fields) <= 8


def test_the_scheduler_names_at_most_20_numbers() -> None:
    assert len(size_page.scheduler_constants()) <= 20


def test_the_page_has_every_row_that_is_counted_in_the_tree() -> None:
    text = size_page.PAGE.read_text("utf-8")

    for what, _, reach in size_page.size_rows():
        assert f"| {what} | " in text  # else: python -m tests.size_page
        assert f" | {reach} |\n" in text
