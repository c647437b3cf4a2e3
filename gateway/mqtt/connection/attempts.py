"""Attempts to connect to a broker, again and again: with which version each, and after which pause.

MQTT 5 first, and 3.1.1 only to a broker that refuses 5. A refusal is a CONNACK that says so, or a connection
that the broker closed right upon the CONNECT, CLOSED times in a row, as brokers do that cannot even read a
CONNECT of MQTT 5. Closed once, it may have been ended or restarted just then. Silence is never a refusal: a
broker that stood still, or a stalled network, knows MQTT 5 as before, and 3.1.1 would hide the retained flag
of what it delivers.
"""

from __future__ import annotations

from gateway.mqtt.connection.reconnect import UNSUPPORTED_VERSION, Version
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.system.rate_limits import Backoff

CLOSED = 2


class Attempts:
    """Those of one client; its seed keeps it out of step with others. `version` is the next attempt's."""

    def __init__(self, settings: BrokerSettings, *, seed: int) -> None:
        self._forced = settings.version
        self.version = settings.version or Version.V5
        self._closed = 0
        self._backoff = Backoff(settings.first_retry_s, settings.last_retry_s, seed=seed)

    def is_next_at_once(self, connack_code: int | None, *, is_closed: bool) -> bool:
        """Note that a connection could not be had; return whether to try at once again.

        `connack_code` is None without a CONNACK; `is_closed` says that the broker closed instead.
        """
        if self.version is not Version.V5 or self._forced is not None:
            return False
        if connack_code is None and is_closed:
            self._closed += 1
            if self._closed < CLOSED:
                return True
        elif connack_code != UNSUPPORTED_VERSION:
            return False
        self.version = Version.V311
        return True

    def pause_s(self) -> float:
        """Return how long to wait before the next attempt, which begins with the newest version."""
        self.version = self._forced or Version.V5
        self._closed = 0
        return self._backoff.next_s()

    def held(self) -> None:
        """Note that a connection has held: the next pause is short again."""
        self._backoff.reset()
