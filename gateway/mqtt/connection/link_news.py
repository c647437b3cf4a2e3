"""Which changes of the connection are reported: each trouble is logged once until a connection has held.

A broker that cannot be reached is tried every few seconds, and refuses each time for the same reason. People
read of it once; `on_link` is called for each change all the same.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field

from gateway.contract import Event, EventCode, event_of
from gateway.mqtt.connection.session import CONNECTION_LOST
from gateway.mqtt.connection.settings import BrokerSettings, Version

log = logging.getLogger(__name__)

SHORT_ONES = 3  # connections in a row that the broker closed soon, until the cause is guessed


@dataclass(slots=True)
class LinkNews:
    """The news of the connections to one broker."""

    settings: BrokerSettings
    on_link: Callable[[Version | None, str], None]
    on_notice: Callable[[Event], None]
    _noticed: set[str] = field(default_factory=set)  # the codes of notices, since a connection held
    _logged: list[str] = field(default_factory=list)  # troubles, likewise; empty for a connection without
    _short_ones: int = 0
    _link: tuple[Version | None, str] = (None, "")

    def report(self, version: Version | None, trouble: str) -> None:
        """Report a connection, or its loss (None), unless that is the state already."""
        if (version, trouble) == self._link:
            return
        self._link = (version, trouble)
        if trouble not in self._logged:
            self._log()
        else:
            log.debug("broker=%s %s", self.settings.address, trouble or "connected")
        self.on_link(version, trouble)

    def held(self) -> None:
        """Note that the connection has held; say so when the loss of an earlier one was logged last."""
        if self._logged[-1:] != [self._link[1]]:
            self._log()
        self._noticed.clear()
        self._logged.clear()
        self._short_ones = 0

    def lost(self, notice: Event | None, reason: str) -> None:
        """Have the cause of a loss published, known or guessed, unless that has been done."""
        if notice is None and reason == CONNECTION_LOST:
            self._short_ones += 1
            if self._short_ones == SHORT_ONES:
                client_id = self.settings.client_id
                notice = event_of(EventCode.CLIENT_ID_TAKEN, "suspected", client_id=client_id)
        if notice is not None and notice.code not in self._noticed:
            self._noticed.add(notice.code)
            self.on_notice(notice)

    def _log(self) -> None:
        version, trouble = self._link
        self._logged.append(trouble)
        connected = f"broker={self.settings.address} connected, MQTT {version}"
        log.log(logging.WARNING if trouble else logging.INFO, "%s", trouble or connected)
