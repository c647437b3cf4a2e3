"""When and how to try the broker again: the pause, and the version of MQTT."""

from __future__ import annotations

import enum
import random

from gateway.mqtt.reasons import UNSUPPORTED_VERSION


class Version(enum.StrEnum):
    """A version of MQTT that the gateway speaks."""

    V5 = "5"
    V311 = "3.1.1"


class Backoff:
    """Pauses that double from `first_s` to `last_s`, each up to a quarter shorter by chance."""

    def __init__(self, *, first_s: float, last_s: float, seed: int) -> None:
        self._first_s = first_s
        self._last_s = last_s
        self._random = random.Random(seed)  # so that many gateways do not come back in step
        self._next_s = first_s

    def next_s(self) -> float:
        """Return how long to wait before the next attempt."""
        pause_s = self._next_s * (1 - 0.25 * self._random.random())
        self._next_s = min(2 * self._next_s, self._last_s)
        return max(pause_s, self._first_s)

    def reset(self) -> None:
        """Begin again with the shortest pause, after a connection that held."""
        self._next_s = self._first_s


class VersionChoice:
    """Which version to speak: 5 first, 3.1.1 to brokers that do not take 5; what once worked is kept."""

    LOYALTY = 3  # unanswered attempts after which a version that once worked is doubted

    def __init__(self, forced: Version | None = None) -> None:
        self.version = forced or Version.V5
        self._is_forced = forced is not None
        self._is_known = False
        self._strikes = 0

    @property
    def is_guess(self) -> bool:
        """Return whether nothing speaks for this version yet."""
        return not self._is_forced and not self._is_known

    def worked(self) -> None:
        """Note that the broker accepted this version."""
        self._is_known = True
        self._strikes = 0

    def failed(self, connack_code: int | None, *, is_reached: bool) -> bool:
        """Note that a connection could not be had; return whether to try the other version at once.

        `connack_code` is None when the broker, if it was reached at all, did not answer.
        """
        if connack_code == UNSUPPORTED_VERSION:
            return self.unsupported()
        return is_reached and connack_code is None and self.unanswered()

    def unsupported(self) -> bool:
        """Note that the broker does not speak this version; return whether to try the other at once."""
        return self._strike(1)

    def unanswered(self) -> bool:
        """Note that the broker closed or kept silent instead of answering; return as `unsupported` does."""
        return self._strike(self.LOYALTY if self._is_known else 1)

    def _strike(self, needed: int) -> bool:
        if self._is_forced:
            return False
        self._strikes += 1
        if self._strikes < needed:
            return False
        self._strikes = 0
        self.version = Version.V311 if self.version is Version.V5 else Version.V5
        return self.version is Version.V311  # back to 5 only after a pause, lest two refusals make a storm
