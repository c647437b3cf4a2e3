"""The outcome of each command, so that none is carried out twice, and when an outcome may be forgotten.

1. A command under way is never forgotten.
2. Beyond `MOST_ENTRIES` the oldest go first: refused commands, reads and stops at once, since they may act
   again without harm; a command that was acted on once no copy of it could still prove itself fresh, however
   many such commands there are: so many a second are admitted at most.
3. A stop under the id of a command that was acted on takes nothing of that command's place.
4. Ages are differences of the steady clock of this run. The wall clock decides nothing.

The stored commands follow: `on_forgotten` gets the keys that have gone.

A command whose id is known already gets its first result, as a duplicate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gateway.contract import MAX_TTL_S, CommandRequest, Note, Phase, ResultRecord, joined
from gateway.starters.policy.freshness import MAX_AHEAD_S

MOST_ENTRIES = 10_000
LONGEST_S = 7 * 24 * 3600.0
PROVABLE_S = MAX_TTL_S + MAX_AHEAD_S  # a copy can prove itself fresh for so long

Key = tuple[str, str]  # client and id

_REPEATABLE = frozenset({"read", "stop"})  # verbs that may act again


@dataclass(slots=True)
class LedgerEntry:
    """A command that has been taken."""

    result: ResultRecord  # the latest
    since_s: float
    is_published: bool  # until its latest result is on the disk, a crash may take it back

    @property
    def is_harmless(self) -> bool:
        """Return whether a copy of the command may act."""
        return self.result.phase is Phase.REJECTED or self.result.verb in _REPEATABLE

    def is_of(self, request: CommandRequest) -> bool:
        """Return whether the id stands for the same wish as before."""
        return (request.starter, request.verb) == (self.result.starter, self.result.verb)

    def answer(self, request: CommandRequest) -> ResultRecord:
        """Return the latest result as the answer to a repetition of the command."""
        text = self.result.text
        if self.result.phase is Phase.REJECTED:
            text = joined(text, Note("stays_refused").text)
        return replace(self.result, text=text, is_duplicate=True, correlation=request.correlation)


@dataclass(kw_only=True)
class Ledger:
    """Remembers (client, id) with the latest result; bounded in number and age."""

    now_s: Callable[[], float]  # the steady clock
    most_entries: int = MOST_ENTRIES
    on_forgotten: Callable[[Sequence[Key]], None] = lambda _: None

    def __post_init__(self) -> None:
        self._entries: dict[Key, LedgerEntry] = {}  # the oldest first

    def find(self, client: str, id_: str | None) -> LedgerEntry | None:
        """Return the command that has been taken under this id; None when there was none."""
        return self._entries.get((client, id_ or ""))

    def store(self, result: ResultRecord, *, is_published: bool = True) -> bool:
        """Store a result as the latest under its id; return whether it was, which needs an id."""
        if not result.id:
            return False
        now_s = self.now_s()
        entry = self._entries.setdefault((result.client, result.id), LedgerEntry(result, now_s, is_published))
        if not entry.is_harmless and result.verb in _REPEATABLE:
            return False  # a stop under a used id is carried out all the same, and may be again
        entry.result, entry.is_published = result, is_published
        self._forget(now_s)
        return True

    def _forget(self, now_s: float) -> None:
        """Drop what is too much and what is too old, as far as it may go; the oldest first."""
        excess = len(self._entries) - self.most_entries
        gone: list[Key] = []
        for key, entry in self._entries.items():
            age_s = now_s - entry.since_s
            if len(gone) >= excess and age_s <= LONGEST_S:
                break
            if entry.result.phase.is_final and (entry.is_harmless or age_s > PROVABLE_S):
                gone.append(key)
        for key in gone:
            del self._entries[key]
        if gone:
            self.on_forgotten(gone)
