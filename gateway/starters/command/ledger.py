"""What became of the commands, so that none is carried out twice, and what may be forgotten when.

1. A command under way is never forgotten.
2. Refused commands, reads and stops go first, the oldest before the others: they may act again without harm.
   A stop that is sent under the id of a command that was acted on takes nothing of that command's place.
3. A command that was acted on stays as long as a copy of it could still prove itself fresh. When the ledger
   is full of these, `has_room` is false and new commands are refused; nothing is forgotten for them.
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
class _LedgerEntry:
    result: ResultRecord  # the latest
    since_s: float
    is_published: bool = True


class Ledger:
    """Remembers (client, id) with the latest result; bounded in number and age."""

    def __init__(
        self,
        *,
        most_entries: int = MOST_ENTRIES,
        longest_s: float = LONGEST_S,
        provable_s: float = PROVABLE_S,
        on_forgotten: Callable[[Sequence[Key]], None] = lambda _: None,
    ) -> None:
        self._most_entries = most_entries
        self._longest_s = longest_s
        self._provable_s = provable_s
        self._on_forgotten = on_forgotten
        self._acted: OrderedDict[Key, _LedgerEntry] = OrderedDict()
        self._harmless: OrderedDict[Key, _LedgerEntry] = OrderedDict()

    def __len__(self) -> int:
        return len(self._acted) + len(self._harmless)

    def find(self, client: str, id_: str | None) -> ResultRecord | None:
        """Return the latest result of a command that has been taken; None when there was none."""
        entry = self._entry((client, id_)) if id_ else None
        return None if entry is None else entry.result

    def is_published(self, client: str, id_: str | None) -> bool:
        """Return whether the latest result is public: until it is on the disk, a crash may take it back."""
        entry = self._entry((client, id_)) if id_ else None
        return entry is None or entry.is_published

    def has_room(self, now_s: float) -> bool:
        """Return whether one more command can be remembered for as long as it must be."""
        return len(self._acted) < self._most_entries or any(True for _ in self._unprovable(now_s))

    def store(self, result: ResultRecord, *, now_s: float, is_published: bool = True) -> bool:
        """Store a result as the latest under its id; return whether it was, which needs an id."""
        if not result.id:
            return False
        key = (result.client, result.id)
        entry = self._entry(key)
        if key in self._acted and result.verb in _REPEATABLE:
            return False  # a stop under a used id is carried out all the same, and may be again
        if entry is None:
            entry = _LedgerEntry(result, now_s)
        entry.result, entry.is_published = result, is_published
        home, other = self._acted, self._harmless
        if not _is_acted_on(result):
            home, other = other, home
        other.pop(key, None)
        home.setdefault(key, entry)
        self._forget(now_s)
        return True

    def _entry(self, key: Key) -> _LedgerEntry | None:
        return self._acted.get(key) or self._harmless.get(key)

    def _forget(self, now_s: float) -> None:
        """Drop what is too much and what is too old, as far as it may go."""
        excess = len(self) - self._most_entries
        over = (key for key, entry in self._harmless.items() if entry.result.phase.is_final)
        gone: list[Key] = []
        for entries, keys in ((self._harmless, over), (self._acted, self._unprovable(now_s))):
            for key in keys:
                if len(gone) >= excess and now_s - entries[key].since_s <= self._longest_s:
                    break
                gone.append(key)
        for key in gone:
            (self._acted if key in self._acted else self._harmless).pop(key)
        if gone:
            self._on_forgotten(gone)

    def _unprovable(self, now_s: float) -> Iterator[Key]:
        """Return, the oldest first, what was acted on and of which no copy can pass for fresh any more."""
        for key, entry in self._acted.items():
            if now_s - entry.since_s <= self._provable_s:
                return  # all that follow are younger
            if entry.result.phase.is_final:
                yield key


def _is_acted_on(result: ResultRecord) -> bool:
    """Return whether carrying the command out once more could do what no operator asked for."""
    return result.phase is not Phase.REJECTED and result.verb not in _REPEATABLE


STAYS_REFUSED = Note("stays_refused")


def is_same(request: CommandRequest, earlier: ResultRecord) -> bool:
    """Return whether the id stands for the same wish as before."""
    return (request.starter, request.verb) == (earlier.starter, earlier.verb)


def as_repetition(earlier: ResultRecord, request: CommandRequest) -> ResultRecord:
    """Return a command's latest result as the answer to its repetition."""
    is_refused = earlier.phase is Phase.REJECTED
    return replace(
        earlier,
        text=joined(earlier.text, STAYS_REFUSED.text) if is_refused else earlier.text,
        is_duplicate=True,
        correlation=request.correlation,
        ticket=request.ticket,
    )
