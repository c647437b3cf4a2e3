"""Where a command's life is kept so that it outlives the gateway; what keeps it stands on another floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from gateway.records import ResultRecord

UNAVAILABLE = "ledger_unavailable"  # the code of a command that is refused because of it


@dataclass(frozen=True, slots=True)
class Remembered:
    """What is known of a command of an earlier run."""

    result: ResultRecord  # its latest; not final when the run ended before the command did
    may_be_written: bool  # something may have reached the starter


class Journal(Protocol):
    """Keeps commands by (client, id), and stops without an id until they end. All calls on the app's loop."""

    @property
    def trouble(self) -> str:
        """Why nothing can be kept now; empty when it can."""
        ...

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:
        """Keep a command's latest phase; `then` is called once, when it is kept or cannot be."""
        ...

    async def intend(self, result: ResultRecord) -> None:
        """Return when it is on the disk that the command is about to be written; CommandError if not."""
        ...

    def forget(self, keys: Sequence[tuple[str, str]]) -> None:
        """Keep these commands no longer, each given by client and id; what goes is the ledger's decision."""
        ...


class NoJournal:
    """Keeps nothing: after its end a gateway knows none of its commands."""

    trouble = ""

    def note(self, result: ResultRecord, *, then: Callable[[], None] | None = None) -> None:  # noqa: ARG002 - Journal's shape
        """Keep nothing."""
        if then is not None:
            then()

    async def intend(self, result: ResultRecord) -> None:
        """Return at once."""

    def forget(self, keys: Sequence[tuple[str, str]]) -> None:
        """Keep nothing, as before."""
