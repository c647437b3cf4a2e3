"""Attempts to connect to a broker, again and again: with which version each, and after which pause."""

from __future__ import annotations

from gateway.mqtt.connection.reconnect import Version, VersionChoice
from gateway.mqtt.connection.session import Session
from gateway.mqtt.connection.settings import BrokerSettings
from gateway.system.rate_limits import Backoff


class Attempts:
    """Those of one client; its seed keeps it out of step with others."""

    def __init__(self, settings: BrokerSettings, *, seed: int) -> None:
        self._choice = VersionChoice(settings.version)
        self._backoff = Backoff(settings.first_retry_s, settings.last_retry_s, seed=seed)

    @property
    def version(self) -> Version:
        """Return the version of the present attempt, or of the next one."""
        return self._choice.version

    def is_next_at_once(self, session: Session) -> bool:
        """Note that a connection could not be had; return whether to try at once again."""
        return self._choice.failed(session.connack_code, is_closed=session.is_closed_unanswered)

    def pause_s(self) -> float:
        """Return how long to wait before the next attempt, which begins with the newest version."""
        self._choice.begin()
        return self._backoff.next_s()

    def held(self) -> None:
        """Note that a connection has held: the next pause is short again."""
        self._backoff.reset()
