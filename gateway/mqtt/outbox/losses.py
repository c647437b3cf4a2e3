"""Rows that were lost before the broker had them: summed up, stored in the table, and declared once."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from gateway.contract import Event, EventCode, event_of, phrase, rfc3339
from gateway.store import Loss, merged

log = logging.getLogger(__name__)

DECLARE_EVERY_S = 60.0  # losses that go on are summed up


class Losses:
    """Losses that are not declared yet; the table has a copy, which a change of them must reach."""

    def __init__(self) -> None:
        self.dropped = 0  # rows, in this run
        self.pending: Sequence[Loss] = ()
        self._declared: Sequence[Loss] = ()  # by an event that is not in the table yet
        self._stored: Sequence[Loss] | None = ()  # what the table has, as far as is known
        self._declared_s = float("-inf")

    def differ_from_stored(self, losses: Sequence[Loss]) -> bool:
        """Return whether the table has others than these, or may have."""
        return self._stored is None or [*self._stored] != [*losses]

    def add(self, loss: Loss) -> None:
        """Note a loss of this run."""
        if not self.dropped:
            log.warning("outbox: messages are lost before the broker has them: %s", loss.reason)
        self.dropped += loss.rows
        self.pending = merged((*self.pending, loss))

    def recall(self, losses: Sequence[Loss]) -> None:
        """Begin with what earlier runs have not declared."""
        self.pending = merged((*self.pending, *losses))
        self._stored = losses

    def with_declared(self) -> Sequence[Loss]:
        """Return all of them, also those whose event is not in the table: a crash would forget it."""
        return merged((*self.pending, *self._declared))

    def note_stored(self, losses: Sequence[Loss] | None) -> None:
        """Note what the table has now; None: that is not known."""
        self._stored = losses

    def note_events_stored(self) -> None:
        """Note that the table has all events, also those that have declared losses."""
        self._declared = ()

    def declare(self, now_s: float) -> Event | None:
        """Return the event that declares all, which must reach the table with the next change of it.

        None when there is nothing to declare, or when it is too soon.
        """
        if not self.pending or now_s < self._declared_s + DECLARE_EVERY_S:
            return None
        event = _gap(self.pending)
        self._declared = (*self._declared, *self.pending)
        self.pending = ()
        self._declared_s = now_s
        return event


def _gap(losses: Sequence[Loss]) -> Event:
    named = (
        phrase(EventCode.GAP, "loss", count=loss.rows, kind=loss.rank.name.lower(), reason=loss.reason)
        for loss in losses
    )
    return event_of(
        EventCode.GAP,
        count=sum(loss.rows for loss in losses),
        first=rfc3339(min(loss.first_s for loss in losses)),
        last=rfc3339(max(loss.last_s for loss in losses)),
        lost=[
            {
                "reason": loss.reason,
                "kind": loss.rank.name.lower(),
                "count": loss.rows,
                "first": rfc3339(loss.first_s),
                "last": rfc3339(loss.last_s),
            }
            for loss in losses
        ],
        losses=", ".join(named),
    )
