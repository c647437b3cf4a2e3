"""What a line tells the floor above: answers to polls, units that come and go, the port."""

from __future__ import annotations

from typing import Protocol

from gateway.line.outcome import Outcome


class LineListener(Protocol):
    """Hears of one or more lines; every call must return at once and must not raise.

    The scheduler calls it on the line's loop; `LineHost` carries the calls over to the app's loop, in order.
    """

    def on_poll(self, line: str, key: str, unit: int, outcome: Outcome) -> None:
        """Hear what became of the poll `key`; a garbled reply is told only when repeating did not help."""
        ...

    def on_unit(self, line: str, unit: int, is_answering: bool, reason: str, frames: tuple[str, ...]) -> None:  # noqa: FBT001 - the seam's exact shape
        """Hear that a unit began to answer or went silent; `frames` are the line's last, oldest first."""
        ...

    def on_trouble(self, line: str, code: str, unit: int, text: str, frames: tuple[str, ...]) -> None:
        """Hear what is wrong on the line (`suspicion.py` has the codes); unit 0 is someone unknown."""
        ...

    def on_port(self, line: str, is_open: bool, reason: str) -> None:  # noqa: FBT001 - the seam's exact shape
        """Hear that the port was opened or is away; told once per change of state or reason."""
        ...
