"""Plain rows for what waits for the broker: the interface between the outbox and its file.

Rows are numbered in the order in which they were put: those of this run from 1, of earlier runs up to 0.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from typing import NamedTuple


class Kind(enum.IntEnum):
    """What a row holds; a full store gives up the first of these first."""

    VALUE = 0  # one item of a history
    EVENT = 1  # an event, or an entry of the audit
    RESULT = 2


class Row(NamedTuple):
    """One message, or one item of a history, that the broker has not acknowledged."""

    number: int
    kind: Kind
    boot: str  # the run that a value belongs to
    topic: str
    payload: bytes
    correlation: bytes | None
    key: str  # names what must be published once, such as a final result ("client/id")
    time_s: float  # when it was put, UTC


class Loss(NamedTuple):
    """Rows that will never be published; the times are UTC, None when unknown."""

    reason: str
    kind: Kind
    rows: int
    first_s: float | None
    last_s: float | None
    upto: int = 0  # the highest number of them


class Refusal(NamedTuple):
    """A publication that the broker would not take."""

    time_s: float
    reason_code: int
    topic: str
    payload: bytes


class Changes(NamedTuple):
    """What is to be written to the file, in one transaction."""

    rows: tuple[Row, ...] = ()
    gone: tuple[tuple[Kind, int], ...] = ()
    refusals: tuple[Refusal, ...] = ()
    losses: tuple[Loss, ...] = ()  # what memory could not hold
    are_losses_declared: bool = False  # those that the file has
    is_flushed: bool = True  # to the disk itself, not only into the kernel


class SpoolPage(NamedTuple):
    """A piece of what is on the disk."""

    rows: tuple[Row, ...]
    is_last: bool  # nothing that was asked for is left
    losses: tuple[Loss, ...] = ()  # rows that were unreadable


class Share(NamedTuple):
    """How much of one kind is on the disk."""

    rows: int
    bytes: int
    first_s: float  # UTC


class Recalled(NamedTuple):
    """What earlier runs have left behind."""

    shares: Mapping[Kind, Share]
    keys: frozenset[str]
    losses: tuple[Loss, ...]  # not declared yet


def merged(losses: Iterable[Loss]) -> tuple[Loss, ...]:
    """Return one loss for each reason and kind."""
    sums: dict[tuple[str, Kind], Loss] = {}
    for loss in losses:
        key = (loss.reason, loss.kind)
        sums[key] = _sum(sums[key], loss) if key in sums else loss
    return tuple(sums.values())


def _sum(one: Loss, other: Loss) -> Loss:
    firsts = [each.first_s for each in (one, other) if each.first_s is not None]
    lasts = [each.last_s for each in (one, other) if each.last_s is not None]
    return Loss(
        one.reason,
        one.kind,
        one.rows + other.rows,
        min(firsts, default=None),
        max(lasts, default=None),
        max(one.upto, other.upto),
    )
