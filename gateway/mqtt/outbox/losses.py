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
        self._stored: Sequence[Loss] | None = ()  # the table's copy; None: it is not known
        self._declared_s = float("-inf")

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

    def unstored(self, *, has_events: bool) -> Sequence[Loss] | None:
        """Return what the table's copy must become, None when it is that.

        Until the table has all events (`has_events`), a crash would forget the one that has declared a loss.
        """
        losses = merged(self.pending if has_events else (*self.pending, *self._declared))
        return None if self._stored is not None and [*self._stored] == losses else losses

    def note_stored(self, losses: Sequence[Loss] | None, *, has_events: bool) -> None:
        """Note that this was stored, with all events or without; None: the copy was right."""
        if losses is not None:
            self._stored = losses
        if has_events:
            self._declared = ()

    def forget_stored(self) -> None:
        """Take it that the table's copy is not known."""
        self._stored = None

    def declare(self, now_s: float) -> Event | None:
        """Return the event that declares all losses, which is to be published at once.

        None when there is nothing to declare, or when it is too soon.
        """
        if not self.pending or now_s < self._declared_s + DECLARE_EVERY_S:
            return None
        declared, self.pending = self.pending, ()
        self._declared = (*self._declared, *declared)
        self._declared_s = now_s
        lost = [
            {
                "reason": loss.reason,
                "kind": loss.rank.name.lower(),
                "count": loss.rows,
                "first": rfc3339(loss.first_s),
                "last": rfc3339(loss.last_s),
            }
            for loss in declared
        ]
        named = (
            phrase(EventCode.GAP, "loss", count=each["count"], kind=each["kind"], reason=each["reason"])
            for each in lost
        )
        return event_of(
            EventCode.GAP,
            count=sum(loss.rows for loss in declared),
            first=rfc3339(min(loss.first_s for loss in declared)),
            last=rfc3339(max(loss.last_s for loss in declared)),
            lost=lost,
            losses=", ".join(named),
        )
