"""Alarms that somebody has acknowledged: seen and taken on, never reset; until they clear or come again.

After a restart of the gateway no alarm is acknowledged: it does not know which of them have come meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gateway.contract import AlarmRecord, EventCode, Record, event_of, rfc3339
from gateway.plugins.interface import Gateway
from gateway.plugins.web.plugin import WebUser


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Who has acknowledged which alarm."""

    user: WebUser
    time_s: float
    came_s: float  # the alarm

    def is_of(self, alarm: Record | None) -> bool:
        """Return whether this alarm is active, and the same one."""
        return isinstance(alarm, AlarmRecord) and alarm.is_active and alarm.time_s == self.came_s


class Acknowledged:
    """All that are valid. On the application's loop."""

    def __init__(self, gateway: Gateway) -> None:
        self._gateway = gateway
        self._known: dict[tuple[str, str], Acknowledgement] = {}  # by starter and code

    def of(self, starter: str) -> dict[str, Any]:
        """Return who has acknowledged which of a starter's alarms, as for JSON."""
        return {
            code: {"by": each.user.name, "client": each.user.client, "time": rfc3339(each.time_s)}
            for (name, code), each in self._known.items()
            if name == starter and each.is_of(self._alarm(starter, code))
        }

    def add(self, starter: str, code: str, user: WebUser) -> bool:
        """Acknowledge an alarm for a login, and say so by an event; return whether it is active."""
        alarm, records = self._alarm(starter, code), self._gateway.records
        if not isinstance(alarm, AlarmRecord) or not alarm.is_active:
            return False
        self._known[starter, code] = Acknowledgement(user, records.clock.utc_s(), alarm.time_s)
        said = event_of(
            EventCode.ALARM_ACKNOWLEDGED,
            alarm=code,
            title=alarm.text,
            client=user.client,
            operator=user.name,
        )
        records.event(starter, said)
        return True

    def put(self, record: Record) -> None:
        """Forget what is over by this record."""
        if isinstance(record, AlarmRecord):
            known = self._known.get((record.starter, record.code))
            if known is not None and not known.is_of(record):
                del self._known[record.starter, record.code]

    def _alarm(self, starter: str, code: str) -> Record | None:
        return self._gateway.latest.find(AlarmRecord.topic_of(starter=starter, code=code))
