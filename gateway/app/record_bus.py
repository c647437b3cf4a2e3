"""The record bus: each record goes to the subscribers that take its kind, in the order that `Parts` names.

1. A subscriber gets the kinds that it names in `takes`; one that names none gets every record.
2. The order is the subscribers' order in `connect`; whatever was put before goes to them first.
3. A subscriber that fails loses that record alone: it is logged, and the others get it all the same.
4. A record that a subscriber puts while it handles another one reaches all of them before that other goes on.
"""

from __future__ import annotations

import logging
from typing import get_args

from gateway.records import Record, Sink

logger = logging.getLogger(__name__)

KINDS: tuple[type[Record], ...] = get_args(Record)


class RecordBus:
    """A sink for everyone who makes records; on the app's loop. Never raises."""

    def __init__(self) -> None:
        self._subscribers: tuple[Sink, ...] = ()
        self._takers: dict[type[Record], tuple[Sink, ...]] = {}
        self._early: list[Record] = []  # put while the gateway was being built

    def connect(self, *subscribers: Sink) -> None:
        """Pass records on to these, in this order, from the first on; once."""
        self._subscribers = subscribers
        self._takers = {
            kind: tuple(each for each in subscribers if kind in getattr(each, "takes", KINDS))
            for kind in KINDS
        }
        early, self._early = self._early, []
        for record in early:
            self.put(record)

    def put(self, record: Record) -> None:
        """Pass one record on."""
        if not self._subscribers:
            self._early.append(record)
            return
        for subscriber in self._takers[type(record)]:
            try:
                subscriber.put(record)
            except Exception:  # one subscriber's bug is not the others'
                logger.exception("subscriber=%s lost a record", type(subscriber).__name__)
