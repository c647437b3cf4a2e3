"""What became of the commands, so that none is carried out twice, and what may be forgotten when.

1. A command under way is never forgotten.
2. Beyond `MOST_ENTRIES` refused commands, reads and stops go first: they may act again without harm.
   A stop that is sent under the id of a command that was acted on takes nothing of that command's place.
3. A command that was acted on stays as long as a copy of it could still prove itself fresh, however many
   there are: so many commands a second are admitted at most.
4. Ages are differences of the steady clock of this run. The wall clock decides nothing.

What is stored on the disk follows: `on_forgotten` gets the keys that have gone.

A command whose id is known already gets its first result, as a duplicate.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from gateway.contract import CommandRequest, Note, Phase, ResultRecord, joined

MOST_ENTRIES = 10_000
LONGEST_S = 7 * 24 * 3600.0
PROVABLE_S = 62.0  # a copy can prove itself fresh for so long: the longest ttl, with a clock that is ahead

Key = tuple[str, str]  # client and id

_REPEATABLE = frozenset({"read", "stop"})  # verbs that may act again


@dataclass(slots=True)
class LedgerEntry:
    """A command that has been taken."""

    result: ResultRecord  # the latest
    since_s: float
    is_published: bool  # until its latest result is on the disk, a crash may take it back

    def is_of(self, request: CommandRequest) -> bool:
        """Return whether the id stands for the same wish as before."""
        return (request.starter, request.verb) == (self.result.starter, self.result.verb)

    def answer(self, request: CommandRequest) -> ResultRecord:
        """Return the latest result as the answer to a repetition of the command."""
        text = self.result.text
        if self.result.phase is Phase.REJECTED:
            text = joined(text, Note("stays_refused").text)
        correlation, ticket = request.correlation, request.ticket
        return replace(self.result, text=text, is_duplicate=True, correlation=correlation, ticket=ticket)


@dataclass(kw_only=True)
class Ledger:
    """Remembers (client, id) with the latest result; bounded in number and age."""

    most_entries: int = MOST_ENTRIES
    provable_s: float = PROVABLE_S
    on_forgotten: Callable[[Sequence[Key]], None] = lambda _: None

    def __post_init__(self) -> None:
        self._acted: OrderedDict[Key, LedgerEntry] = OrderedDict()  # acting again could do harm
        self._harmless: OrderedDict[Key, LedgerEntry] = OrderedDict()

    def __len__(self) -> int:
        return len(self._acted) + len(self._harmless)

    def find(self, client: str, id_: str | None) -> LedgerEntry | None:
        """Return the command that has been taken under this id; None when there was none."""
        key = (client, id_ or "")
        return self._acted.get(key) or self._harmless.get(key)

    def store(self, result: ResultRecord, *, now_s: float, is_published: bool = True) -> bool:
        """Store a result as the latest under its id; return whether it was, which needs an id."""
        if not result.id:
            return False
        key = (result.client, result.id)
        if key in self._acted and result.verb in _REPEATABLE:
            return False  # a stop under a used id is carried out all the same, and may be again
        entry = self.find(*key) or LedgerEntry(result, now_s, is_published)
        entry.result, entry.is_published = result, is_published
        home, other = self._acted, self._harmless
        if result.phase is Phase.REJECTED or result.verb in _REPEATABLE:
            home, other = other, home
        other.pop(key, None)
        home.setdefault(key, entry)
        self._forget(now_s)
        return True

    def _forget(self, now_s: float) -> None:
        """Drop what is too much and what is too old, as far as it may go; the oldest first."""
        excess = len(self) - self.most_entries
        over = (key for key, entry in self._harmless.items() if entry.result.phase.is_final)
        gone: list[Key] = []
        for entries, keys in ((self._harmless, over), (self._acted, self._unprovable(now_s))):
            for key in keys:
                if len(gone) >= excess and now_s - entries[key].since_s <= LONGEST_S:
                    break
                gone.append(key)
        for key in gone:
            (self._acted if key in self._acted else self._harmless).pop(key)
        if gone:
            self.on_forgotten(gone)

    def _unprovable(self, now_s: float) -> Iterator[Key]:
        """Return, the oldest first, what was acted on and of which no copy can pass for fresh any more."""
        for key, entry in self._acted.items():
            if now_s - entry.since_s <= self.provable_s:
                return  # all that follow are younger
            if entry.result.phase.is_final:
                yield key
