"""The interface of the command ledger: phases of commands that must outlive the gateway."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from gateway.contract import ResultRecord


@dataclass(frozen=True, slots=True)
class Remembered:
    """What is known of a command of an earlier run."""

    result: ResultRecord  # its latest; not final when the run ended before the command did
    may_be_written: bool  # something may have reached the starter


class Journal(Protocol):
    """Stores commands by (client, id), stops without an id until they end. All calls on the app's loop."""

    @property
    def trouble(self) -> str:
        """Why nothing can be stored now; empty when it can."""

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        """Store a command's latest phase; `then` is called once, when it is stored or cannot be."""

    def after(self, then: Callable[[], None]) -> None:
        """Call this once, when all that was noted so far is stored or cannot be."""

    async def intend(self, result: ResultRecord) -> None:
        """Return when it is on the disk that the command is about to be written; CommandError if not."""

    def forget(self, keys: Sequence[tuple[str, str]]) -> None:
        """Delete these commands, each given by client and id, as the ledger decided."""


class NoJournal:
    """Stores nothing: the next run knows none of this run's commands."""

    trouble = ""

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:  # noqa: ARG002 - Journal's shape
        """Store nothing."""
        if then is not None:
            then()

    def after(self, then: Callable[[], None]) -> None:
        """Call it at once."""
        then()

    async def intend(self, result: ResultRecord) -> None:
        """Return at once."""

    def forget(self, keys: Sequence[tuple[str, str]]) -> None:
        """Do nothing."""
