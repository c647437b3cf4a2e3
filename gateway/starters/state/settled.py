"""Values that two readings in a row agree on: a single reading is no event.

A value that was read once waits, with the circumstances of that first reading: they are the event's.
A point that is not known any more is neither settled nor waiting.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from gateway.starters.state.readings import Points, Value

STARTED = frozenset({"starting", "running"})

_NOTHING = object()


class EarlierPoints(NamedTuple):
    """What all points said when a new status came; `at_s` is the status's, on the steady clock."""

    at_s: float
    points: Points


class FirstSeen(NamedTuple):
    """A value that was read once, with the circumstances of that reading."""

    value: Value
    at_s: float  # of its reply, steady clock
    now_s: float  # when it was looked at
    utc_s: float
    earlier: tuple[EarlierPoints, ...]  # before it, the oldest first


@dataclass(frozen=True, slots=True)
class Settled:
    """`values` are settled: one that is about to change keeps its last value, and the new one waits."""

    values: Mapping[str, Value] = field(default_factory=dict)
    waiting: Mapping[str, FirstSeen] = field(default_factory=dict)


def settle(before: Settled, seen: Mapping[str, FirstSeen]) -> tuple[Settled, Mapping[str, FirstSeen]]:
    """Return the settled values after a look at all points that are known now.

    Besides, return what has settled by this look, each with its first reading.
    """
    values = {name: value for name, value in before.values.items() if name in seen}
    waiting: dict[str, FirstSeen] = {}
    new: dict[str, FirstSeen] = {}
    for name, now in seen.items():
        if values.get(name, _NOTHING) == now.value:
            continue
        first = before.waiting.get(name)
        if first is None or not _agree(first.value, now.value):
            waiting[name] = now
        elif now.at_s > first.at_s:
            values[name], new[name] = now.value, first
        else:  # the same reading, looked at again
            waiting[name] = first
    return Settled(values, waiting), new


def _agree(one: Value, other: Value) -> bool:
    """Return whether two readings say the same of what makes events: starting and running are both on."""
    return bool(one == other) or {str(one), str(other)} <= STARTED
