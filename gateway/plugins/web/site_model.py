"""What the page shows: the newest records, which `Latest` holds, and what happened lately; pure.

A client that has seen both up to a number each (`Seen`) is sent what is newer.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from gateway.contract import (
    AlarmRecord,
    AuditRecord,
    EventCode,
    EventRecord,
    InfoRecord,
    Latest,
    Phase,
    Record,
    ResultRecord,
    StartRecord,
    TripRecord,
    ValueRecord,
    rfc3339,
)
from gateway.plugins.web.acknowledged import Acknowledged
from gateway.plugins.web.plugin import WebSettings

MOST_MESSAGES = 200  # events and audit entries; as many results
MOST_COMMANDS = 20  # of a starter
MOST_PHASES = 8  # of a command
MOST_RECORDS = 64  # starts and trips of all starters, each some 20 KB

_OVERVIEW = frozenset({"state", "availability", "alarm"})
_OVERVIEW_VALUES = frozenset({"current", "current_pct"})
_FACTS = ("model", "firmware", "serial", "rated_current_a", "rating")  # of a starter's info


class Seen(NamedTuple):
    """How far a client knows the site."""

    latest: int  # the number of `Latest`
    happened: int  # of the messages

    @property
    def gen(self) -> int:
        """Return one number that grows with every change."""
        return self.latest + self.happened


class SiteMessage(NamedTuple):
    """Something that happened."""

    number: int
    record: Record


class SiteModel:
    """Takes records; on the application's loop."""

    def __init__(self, settings: WebSettings, latest: Latest, acknowledged: Acknowledged) -> None:
        self.settings = settings
        self.acknowledged = acknowledged
        self.latest = latest
        self._happened = 1
        self._events: deque[SiteMessage] = deque(maxlen=MOST_MESSAGES)  # and audit entries
        self._results: deque[SiteMessage] = deque(maxlen=MOST_MESSAGES)
        self._records: deque[SiteMessage] = deque(maxlen=MOST_RECORDS)  # starts and trips
        self._commands: dict[str, deque[dict[str, Any]]] = {}  # as for JSON

    @property
    def now(self) -> Seen:
        """Return up to where everything is known here."""
        return Seen(self.latest.number, self._happened)

    def reconfigure(self, settings: WebSettings) -> None:
        """Show another configuration; what it does not name is forgotten."""
        self.settings = settings
        self._happened += 1
        for name in [name for name in self._commands if not self.is_target(name)]:
            del self._commands[name]

    def put(self, record: Record) -> None:
        """Take a record; `Latest` has those that are retained."""
        self.acknowledged.put(record)
        match record:
            case ResultRecord():
                self._note(record, self._results)
                self._note_result(record)
            case AuditRecord():
                self._note(record, self._events)
                self._note_decision(record)
            case EventRecord():
                self._note(record, self._events)
            case StartRecord() | TripRecord():
                self._note(record, self._records)

    def topics(self, scope: str | None, since: int = 0) -> list[tuple[str, Record | None]]:
        """Return the topics of a client of this scope that have changed since a number, the oldest first.

        What no longer exists has no record; from the beginning (0) it is left out.
        """
        of_scope = f"starter/{scope}/"
        changed = [
            (topic, record)
            for topic, record in self.latest.newer_than(since)
            if (since or record is not None) and (_is_overview(topic) or topic.startswith(of_scope))
        ]
        changed.reverse()
        return changed

    def messages(self, scope: str | None, since: int = 0) -> list[Record] | None:
        """Return what happened since a number, oldest first; None when that is no longer known."""
        rings = self._events, self._results, self._records
        if since and any(len(ring) == ring.maxlen and ring[0].number > since + 1 for ring in rings):
            return None
        found = [each for each in self._events if each.number > since]
        if since:
            found += [each for each in self._results if each.number > since]
            found += [each for each in self._records if each.number > since and _is_of(each.record, scope)]
        elif scope is not None:
            found += [each for each in self._results if _is_of(each.record, scope)][-MOST_COMMANDS:]
        return [each.record for each in sorted(found, key=lambda each: each.number)]

    def facts(self, starter: str) -> dict[str, Any]:
        """Return what is known of a starter besides its readings; a reload may just have removed it."""
        groups = [name for name, group in self.settings.groups.items() if starter in group["starters"]]
        info = self.latest.find(InfoRecord.topic_of(starter=starter))
        said = {name: getattr(info, name, None) for name in _FACTS}
        known = {name: value for name, value in said.items() if value is not None}
        facts = {**self.settings.starters.get(starter, {}), "groups": groups, **known}
        return {**facts, "acknowledged": self.acknowledged.of(starter)}

    def facts_since(self, since: Seen) -> dict[str, dict[str, Any]]:
        """Return the facts of starters that may have changed since then."""
        records = [record for _, record in self.latest.newer_than(since.latest)]
        changed = {each.starter for each in records if isinstance(each, InfoRecord | AlarmRecord)}
        for number, record in self._events:
            if number > since.happened and isinstance(record, EventRecord):
                changed.add(record.starter if record.code == EventCode.ALARM_ACKNOWLEDGED else "")
        return {name: self.facts(name) for name in self.settings.starters if name in changed}

    def unit(self, starter: str, point: str) -> str | None:
        """Return the unit of a point; None while the starter has not given it."""
        record = self.latest.find(ValueRecord.topic_of(starter=starter, point=point))
        return record.unit if isinstance(record, ValueRecord) else None

    def is_target(self, name: str) -> bool:
        """Return whether a command may name it: a starter, or a group."""
        return name in self.settings.starters or name in self.settings.groups

    def commands(self, starter: str) -> list[Mapping[str, Any]]:
        """Return a starter's last commands, oldest first."""
        return list(self._commands.get(starter, ()))

    def _note(self, record: Record, ring: deque[SiteMessage]) -> None:
        self._happened += 1
        ring.append(SiteMessage(self._happened, record))

    def _note_decision(self, record: AuditRecord) -> None:
        """Add to a command what its results do not say; a rejected one without id is no command shown."""
        is_shown = record.decision == "accepted" or (record.decision == "rejected" and bool(record.id))
        if is_shown and self.is_target(record.starter):
            self._command(record).update(args=record.args, source=record.source or "mqtt")

    def _note_result(self, record: ResultRecord) -> None:
        if not self.is_target(record.starter):
            return
        command = self._command(record)
        phase = {"phase": record.phase, "code": record.code, "text": record.text}
        command["phases"] = [*command["phases"], {**phase, "time": rfc3339(record.time_s)}][-MOST_PHASES:]

    def _command(self, record: AuditRecord | ResultRecord) -> dict[str, Any]:
        """Return the command that a record is about; without id the last one of its verb that is not over."""
        commands = self._commands.setdefault(record.starter, deque(maxlen=MOST_COMMANDS))
        named = {"id": record.id, "client": record.client, "verb": record.verb}
        command = next((each for each in reversed(commands) if named.items() <= each.items()), None)
        if command is None or (not record.id and _is_over(command)):
            command = {**named, "args": {}, "source": "mqtt", "phases": []}
            commands.append(command)
        return command


def _is_over(command: Mapping[str, Any]) -> bool:
    phases = command["phases"]
    return bool(phases) and Phase(phases[-1]["phase"]).is_final


def _is_of(record: Record, starter: str | None) -> bool:
    return getattr(record, "starter", None) == starter


@cache  # as many as there are points; a snapshot looks at each
def _is_overview(topic: str) -> bool:
    """Return whether every client is sent a topic: what an overview shows."""
    branch, _, *rest = topic.split("/")
    if branch != "starter":
        return True
    return rest[0] in _OVERVIEW or (rest[0] == "value" and rest[1] in _OVERVIEW_VALUES)
