"""The audit's hash chain: each line carries the SHA-256 of the hash before it and of its own canonical JSON.

To change, remove or insert a line, one must recompute every later one; then the newest hash differs from the
one that an auditor may have noted.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

FIRST_HASH = "0" * 64  # before the first line
MOST_PROBLEMS = 20

_NUMBER, _PREVIOUS, _HASH = "n", "prev", "hash"


@dataclass(frozen=True, slots=True)
class Head:
    """Where a chain stands: the number and the hash of its last line."""

    number: int = 0
    hash: str = FIRST_HASH


@dataclass(frozen=True, slots=True)
class Verification:
    """What a check of a chain found; it is whole when there are no problems."""

    count: int
    head: Head
    problems: tuple[str, ...]


def canonical(value: Any) -> str:
    """Return the one JSON text of a value: keys sorted, no blanks; what JSON does not know as a text."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, default=str)
    return text.encode("utf-8", "replace").decode()


def link(head: Head, body: Mapping[str, Any]) -> tuple[str, Head]:
    """Return the next line of the chain, and where the chain stands then."""
    numbered = {**body, _NUMBER: head.number + 1}
    after = Head(head.number + 1, _hash(head.hash, numbered))
    return canonical({**numbered, _PREVIOUS: head.hash, _HASH: after.hash}), after


def read_line(line: str) -> tuple[dict[str, Any], Head]:
    """Return what a line says and where the chain stands after it; ValueError for another line."""
    entry = json.loads(line)
    if not isinstance(entry, dict) or canonical(entry) != line:
        raise ValueError("not a line as the gateway writes it")
    number, hash_ = entry.get(_NUMBER), entry.get(_HASH)
    if type(number) is not int or not isinstance(hash_, str):
        raise ValueError("a line without its number and hash")
    return entry, Head(number, hash_)


def verify(lines: Iterable[tuple[str, str]], *, after: Head | None) -> Verification:
    """Check lines, each with its place; `after` is the line before them, None when it is unknown."""
    head, count, problems = after, 0, list[str]()
    for place, line in lines:
        count += 1
        try:
            entry, stated = read_line(line)
        except ValueError as error:
            problems.append(f"{place}: {error}")
            continue
        problems += (f"{place}: {problem}" for problem in _problems(entry, stated, head))
        head = stated
    if len(problems) > MOST_PROBLEMS:
        problems[MOST_PROBLEMS:] = [f"and {len(problems) - MOST_PROBLEMS} more"]
    return Verification(count, head or Head(), tuple(problems))


def _problems(entry: dict[str, Any], stated: Head, before: Head | None) -> Iterator[str]:
    previous = entry.get(_PREVIOUS)
    body = {key: value for key, value in entry.items() if key not in (_PREVIOUS, _HASH)}
    if _hash(str(previous), body) != stated.hash:
        yield "was changed: its hash is another"
    if before is not None and (stated.number, previous) != (before.number + 1, before.hash):
        yield f"does not follow line {before.number}: something was removed, inserted or exchanged"


def _hash(previous: str, body: Mapping[str, Any]) -> str:
    return hashlib.sha256(f"{previous}{canonical(body)}".encode()).hexdigest()
