"""The record bus: every record goes to every subscriber, in the one order that `App` names.

1. The order is the subscribers' order in `connect`; whatever was put before goes to them first.
2. A subscriber that fails loses that record alone: it is logged, and the others get it all the same.
3. A record that a subscriber puts while it handles another one reaches all of them before that other goes on.
"""

from __future__ import annotations

import logging

from gateway.records import Record, Sink

logger = logging.getLogger(__name__)


class RecordBus:
    """A sink for everyone who makes records; on the app's loop. Never raises."""

    def __init__(self) -> None:
        self._subscribers: tuple[Sink, ...] = ()
        self._early: list[Record] = []  # put while the gateway was being built

    def connect(self, *subscribers: Sink) -> None:
        """Pass records on to these, in this order, from the first on; once."""
        self._subscribers = subscribers
        early, self._early = self._early, []
        for record in early:
            self.put(record)

    def put(self, record: Record) -> None:
        """Pass one record on."""
        if not self._subscribers:
            self._early.append(record)
        for subscriber in self._subscribers:
            try:
                subscriber.put(record)
            except Exception:  # one subscriber's bug is not the others'
                logger.exception("subscriber=%s lost a record", type(subscriber).__name__)
