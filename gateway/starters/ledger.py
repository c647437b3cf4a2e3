"""What became of the commands of this boot, so that none is carried out twice."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from gateway.starters.records import ResultRecord

MOST_ENTRIES = 10_000
LONGEST_S = 7 * 24 * 3600.0


@dataclass(slots=True)
class _Entry:
    result: ResultRecord  # the latest
    since_s: float


class Ledger:
    """Remembers (client, id) with the latest result; bounded, the oldest finished entries go first."""

    def __init__(self, *, most_entries: int = MOST_ENTRIES, longest_s: float = LONGEST_S) -> None:
        self._most_entries = most_entries
        self._longest_s = longest_s
        self._entries: OrderedDict[tuple[str, str], _Entry] = OrderedDict()

    def __len__(self) -> int:
        return len(self._entries)

    def find(self, client: str, id_: str | None) -> ResultRecord | None:
        """Return the latest result of a command that has been taken; None when there was none."""
        entry = self._entries.get((client, id_)) if id_ else None
        return None if entry is None else entry.result

    def store(self, result: ResultRecord, *, now_s: float) -> None:
        """Keep a result as its command's latest; one without an id is not kept."""
        if not result.id:
            return
        entry = self._entries.get((result.client, result.id))
        if entry is not None:
            entry.result = result
            return
        self._entries[result.client, result.id] = _Entry(result, now_s)
        self._forget(now_s)

    def _forget(self, now_s: float) -> None:
        """Drop what is too old and what is too much; a command under way stays whatever its age."""
        excess = len(self._entries) - self._most_entries
        gone: list[tuple[str, str]] = []
        for key, entry in self._entries.items():
            if len(gone) >= excess and now_s - entry.since_s <= self._longest_s:
                break
            if entry.result.phase.is_final:
                gone.append(key)
        for key in gone:
            del self._entries[key]
