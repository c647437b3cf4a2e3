from __future__ import annotations

from tests.families.golden import TABLE, table


def test_what_is_read_written_and_concluded_is_what_was_recorded() -> None:
    """A line that differs says which family and verb; `python -m tests.families.golden --whole` says what."""
    assert table() == TABLE.read_text("utf-8").splitlines()
