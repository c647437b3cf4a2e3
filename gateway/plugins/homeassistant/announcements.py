"""Which discovery topics the broker holds or may hold, and what has to be done about each; pure.

1. A topic is remembered before its first message goes out, so that a later run can have it deleted.
2. It is deleted, by an empty message, once it is not wanted, and forgotten once the broker has confirmed
   that.
3. The birth of Home Assistant is answered by all messages again, after a pause drawn by chance, so that many
   gateways do not answer together; at most once in `LONGEST_PAUSE_S`.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Mapping
from typing import Any

from gateway.errors import DamagedError

LONGEST_PAUSE_S = 5.0
BORN = b"online"  # Home Assistant's birth message; its will is `offline`


class Announcements:
    """The topics of one gateway."""

    def __init__(self, document: Mapping[str, Any] | None) -> None:
        """Begin with what an earlier run has stored; DamagedError."""
        topics = [] if document is None else document.get("topics")
        if not isinstance(topics, list) or not all(isinstance(topic, str) for topic in topics):
            raise DamagedError("it has no list of topics")
        self._topics: set[str] = set(topics)

    def document(self) -> dict[str, Any]:
        """Return what the next run needs."""
        return {"topics": sorted(self._topics)}

    def add(self, topics: Collection[str]) -> bool:
        """Note topics that will be published; return whether any of them is new."""
        before = len(self._topics)
        self._topics.update(topics)
        return len(self._topics) > before

    def unwanted(self, wanted: Collection[str]) -> list[str]:
        """Return the topics that the broker has to delete."""
        return sorted(self._topics.difference(wanted))

    def forget(self, topic: str) -> None:
        """Note that the broker has deleted a topic."""
        self._topics.discard(topic)


class BirthPause:
    """When the next answer to a birth is due; times on the steady clock."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)
        self._due_s: float | None = None
        self._answered_s = -LONGEST_PAUSE_S

    def take(self, payload: bytes, now_s: float) -> None:
        """Take a message of the birth topic; what comes while an answer is due is answered with it."""
        if payload == BORN and self._due_s is None:
            pause_s = self._chance.uniform(0.0, LONGEST_PAUSE_S)
            self._due_s = max(now_s + pause_s, self._answered_s + LONGEST_PAUSE_S)

    def left_s(self, now_s: float) -> float | None:
        """Return how long it is until an answer is due, 0 when it is; None while there was no birth."""
        return None if self._due_s is None else max(0.0, self._due_s - now_s)

    def answered(self, now_s: float) -> None:
        """Note that all messages were published again."""
        self._due_s = None
        self._answered_s = now_s
