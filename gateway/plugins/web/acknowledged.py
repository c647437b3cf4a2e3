"""Alarms that somebody has acknowledged: seen and taken on, never reset; until they clear or come again.

Each is stored with the run and the time in which its alarm came. After a restart an alarm that is active when
the starter is first read counts as the same one; one that comes later does not: it has cleared meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from gateway.contract import AlarmRecord, EventCode, Quality, Record, StateRecord, event_of, rfc3339
from gateway.plugins.interface import Gateway
from gateway.plugins.web.plugin import WebUser

DOCUMENT = "acknowledged"
SETTLED_S = 10.0  # after a starter's first good state all alarms that were active then have been published


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Who has acknowledged which alarm."""

    by: str  # the login
    client: str
    time_s: float
    came_s: float
    boot: str  # of the run in which it came

    def is_of(self, alarm: Record | None) -> bool:
        """Return whether this alarm is active, and the same one."""
        if not isinstance(alarm, AlarmRecord) or not alarm.is_active:
            return False
        return alarm.time_s == self.came_s if alarm.boot == self.boot else alarm.count == 1


ALL = TypeAdapter(dict[str, dict[str, Acknowledgement]])  # by starter and code


class Acknowledged:
    """All that are valid; they outlive a restart. On the application's loop."""

    def __init__(self, gateway: Gateway) -> None:
        self._gateway = gateway
        self._document = gateway.documents.open(DOCUMENT, ALL, lambda: self._known)
        self._known: dict[str, dict[str, Acknowledgement]] = self._document.loaded or {}
        self._read_s: dict[str, float] = {}  # when a starter was first read in this run, on the steady clock

    def of(self, starter: str) -> dict[str, Any]:
        """Return who has acknowledged which of a starter's alarms, as for JSON."""
        return {
            code: {"by": each.by, "client": each.client, "time": rfc3339(each.time_s)}
            for code, each in self._known.get(starter, {}).items()
            if each.is_of(self._alarm(starter, code))
        }

    def add(self, starter: str, code: str, user: WebUser) -> bool:
        """Acknowledge an alarm for a login, and say so by an event; return whether it is active."""
        alarm, records = self._alarm(starter, code), self._gateway.records
        if not isinstance(alarm, AlarmRecord) or not alarm.is_active:
            return False
        made = Acknowledgement(user.name, user.client, records.clock.utc_s(), alarm.time_s, alarm.boot)
        self._known.setdefault(starter, {})[code] = made
        self._document.touch()
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
        match record:
            case AlarmRecord():
                codes = {record.code}
            case StateRecord(quality=Quality.GOOD):
                now_s = self._gateway.clock.now_s()
                is_settled = now_s - self._read_s.setdefault(record.starter, now_s) > SETTLED_S
                is_clear = record.flags.get("fault") is False and not record.flags.get("alarm")
                codes = set(self._known.get(record.starter, ())) if is_settled or is_clear else set()
            case _:
                return
        for code in codes:
            known = self._known.get(record.starter, {}).get(code)
            if known is not None and not known.is_of(self._alarm(record.starter, code)):
                del self._known[record.starter][code]
                self._document.touch()

    def _alarm(self, starter: str, code: str) -> Record | None:
        return self._gateway.latest.find(AlarmRecord.topic_of(starter=starter, code=code))
