"""How far a command has come."""

from __future__ import annotations

import io
import re

import pytest

from gateway.cli.command import Progress, in_words


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_one_line_changes_and_is_taken_away_at_the_end() -> None:
    terminal = Terminal()
    progress = Progress(terminal)

    progress.show(0.1, "one")
    progress.show(0.2, "two")
    progress.say("found")
    progress.clear()

    said = terminal.getvalue()
    assert said.count("\n") == 1
    assert said.endswith("\r\x1b[Kfound\n\r\x1b[K")
    assert re.search(r" 10% one, \d\.\d s left\r", said)


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
