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
    """Which version to speak: 5 at each attempt to connect, 3.1.1 only to a broker that refuses 5.

    A refusal is a CONNACK that says so, or a connection that the broker closed right upon the CONNECT, CLOSED
    times in a row, as brokers do that cannot even read a CONNECT of MQTT 5. Closed once, it may have been
    ended or restarted just then. Silence is never a refusal: a broker that stood still, or a stalled network,
    knows MQTT 5 as before, and 3.1.1 would hide the retained flag of what it delivers.
    """

    CLOSED = 2

    def __init__(self, forced: Version | None = None) -> None:
        self._forced = forced
        self.version = forced or Version.V5
        self._closed = 0

    def begin(self) -> None:
        """Begin another attempt to connect, after a pause."""
        self.version = self._forced or Version.V5
        self._closed = 0

    def failed(self, connack_code: int | None, *, is_closed: bool) -> bool:
        """Note that a connection could not be had; return whether to try at once again, by `version`.

        `connack_code` is None without a CONNACK; `is_closed` says that the broker closed instead.
        """
        if self.version is not Version.V5 or self._forced is not None:
            return False
        if connack_code is None and is_closed:
            self._closed += 1
            if self._closed < self.CLOSED:
                return True
        elif connack_code != UNSUPPORTED_VERSION:
            return False
        self.version = Version.V311
        return True
