"""Which changes of the connection are reported: a repeated refusal for the same reason is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from gateway.contract import Event, EventCode, event_of
from gateway.mqtt.connection.session import CONNECTION_LOST
from gateway.mqtt.connection.settings import Version

SHORT_ONES = 3  # connections in a row that the broker closed soon, until the cause is guessed


@dataclass(slots=True)
class LinkNews:
    """The news of the connections of one client."""

    client_id: str
    on_link: Callable[[Version | None, str], None]
    on_notice: Callable[[Event], None]
    link: tuple[Version | None, str] = (None, "")  # the version, and what is wrong, as reported last
    _noticed: set[str] = field(default_factory=set)  # the codes of notices, since a connection held
    _short_ones: int = 0

    def report(self, version: Version | None, trouble: str) -> None:
        """Report a connection, or its loss (None), unless that is the state already."""
        if (version, trouble) != self.link:
            self.link = (version, trouble)
            self.on_link(version, trouble)

    def held(self) -> None:
        """Note that the connection has held: a notice that comes after it is news again."""
        self._noticed.clear()
        self._short_ones = 0

    def lost(self, notice: Event | None, reason: str) -> None:
        """Have the cause of a loss published, known or guessed, unless that has been done."""
        if notice is None and reason == CONNECTION_LOST:
            self._short_ones += 1
            if self._short_ones == SHORT_ONES:
                notice = event_of(EventCode.CLIENT_ID_TAKEN, "suspected", client_id=self.client_id)
        if notice is not None and notice.code not in self._noticed:
            self._noticed.add(notice.code)
            self.on_notice(notice)
