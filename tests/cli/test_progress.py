"""How far a command has come."""

from __future__ import annotations

import io

import pytest

from gateway.cli.command import Progress, in_words


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_one_line_changes_and_is_taken_away_at_the_end() -> None:
    terminal = Terminal()
    progress = Progress(terminal)

    progress.show(0.1, "one", left_s=9)
    progress.show(0.2, "two")
    progress.say("found")
    progress.clear()

    assert "\n" not in terminal.getvalue().removesuffix("found\n")
    assert terminal.getvalue().endswith("\r\x1b[Kfound\n")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.0 s"),
        (-1, "0.0 s"),
        (9.94, "9.9 s"),
        (38.2, "38 s"),
        (200, "3 min 20 s"),
        (3900, "1 h 5 min"),
    ],
)
def test_durations_are_written_in_words(seconds: float, text: str) -> None:
    assert in_words(seconds) == text
