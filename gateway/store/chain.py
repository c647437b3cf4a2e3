"""The audit's hash chain: each line carries the SHA-256 of the hash before it and of its own canonical JSON.

To change, remove or insert a line, one must recompute every later one; then the newest hash differs from the
one that an auditor may have noted.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

FIRST_HASH = "0" * 64  # before the first line

_NUMBER, _PREVIOUS, _HASH = "n", "prev", "hash"


class Head(NamedTuple):
    """A place in a chain: the number and the hash of the line before it."""

    number: int = 0
    hash: str = FIRST_HASH


@dataclass(frozen=True, slots=True)
class Verification:
    """The findings of a check of a chain; it is whole when there are no problems."""

    count: int
    head: Head
    problems: Sequence[str]


def canonical(value: Any) -> str:
    """Return the one JSON text of a value: keys sorted, no blanks; what JSON does not know as a text."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, default=str)
    return text.encode("utf-8", "replace").decode()


def link(head: Head, body: Mapping[str, Any]) -> tuple[str, Head]:
    """Return the next line of the chain, and the place behind it."""
    numbered = {**body, _NUMBER: head.number + 1}
    after = Head(head.number + 1, _hash(head.hash, numbered))
    return canonical({**numbered, _PREVIOUS: head.hash, _HASH: after.hash}), after


def read_line(line: str) -> tuple[dict[str, Any], Head]:
    """Return what a line says and the place behind it; ValueError for another line."""
    entry = json.loads(line)
    if not isinstance(entry, dict) or canonical(entry) != line:
        raise ValueError("not a line as the gateway writes it")
    number, hash_ = entry.get(_NUMBER), entry.get(_HASH)
    if type(number) is not int or not isinstance(hash_, str):
        raise ValueError("a line without its number and hash")
    return entry, Head(number, hash_)


def verify(lines: Iterable[tuple[str, str]], *, after: Head) -> Verification:
    """Check lines, each with what it is called in a problem; `after` is the place before the first."""
    head, count, problems = after, 0, list[str]()
    for name, line in lines:
        count += 1
        try:
            entry, stated = read_line(line)
        except ValueError as error:
            problems.append(f"{name}: {error}")
            continue
        previous = entry.pop(_PREVIOUS, None)
        del entry[_HASH]
        if _hash(str(previous), entry) != stated.hash:
            problems.append(f"{name}: was changed: its hash is another")
        if (stated.number, previous) != (head.number + 1, head.hash):
            gap = f"does not follow line {head.number}: something was removed, inserted or exchanged"
            problems.append(f"{name}: {gap}")
        head = stated
    return Verification(count, head, problems)


def _hash(previous: str, body: Mapping[str, Any]) -> str:
    return hashlib.sha256(f"{previous}{canonical(body)}".encode()).hexdigest()
