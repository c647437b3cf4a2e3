"""What the page shows: the newest payload of each topic, and what happened lately; pure.

Each change has a generation; a client that has seen one is sent what is newer.
"""

from __future__ import annotations

import json
import sys
from collections import OrderedDict, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from gateway.contract import (
    AuditRecord,
    ForgetRecord,
    HistoryRecord,
    InfoRecord,
    Phase,
    Quality,
    Record,
    ResultRecord,
    StartRecord,
    TripRecord,
    ValueRecord,
    rfc3339,
)
from gateway.plugins.web.plots import NAN, StarterPlots

MOST_MESSAGES = 200  # events and audit entries
MOST_COMMANDS = 20  # of a starter
MOST_RECORDS = 20  # starts, and trips, of a starter
MOST_RECORD_BYTES = 2_000_000  # of all starters together

_OVERVIEW = frozenset({"state", "availability", "alarm"})
_OVERVIEW_VALUES = frozenset({"current", "current_pct"})
_VOLTAGES = ("line_voltage", "output_voltage")
_RECORDS = ("start", "trip")
_FACTS = ("model", "firmware", "serial", "rated_current_a", "rating")  # of a starter's info


class TopicPlace(NamedTuple):
    """Where a topic belongs."""

    name: str  # the topic below the base
    starter: str  # empty for the gateway's and the lines'
    is_overview: bool


@dataclass(slots=True)
class _Latest:
    """The newest payload of a retained topic; there are thousands of these."""

    gen: int
    payload: bytes | None
    starter: str
    is_overview: bool

    def is_for(self, scope: str | None) -> bool:
        """Return whether a client is sent it: what an overview shows, or all of its starter."""
        return self.is_overview or self.starter == scope


class SiteMessage(NamedTuple):
    """Something that happened: its generation, topic and payload."""

    gen: int
    place: TopicPlace
    payload: bytes


@dataclass(frozen=True, slots=True)
class ShownSite:
    """What the configuration says of starters, lines and groups, by name."""

    gateway: str
    base: str
    version: str
    contract: int
    starters: Mapping[str, Mapping[str, Any]]
    lines: Mapping[str, Mapping[str, Any]]
    groups: Mapping[str, tuple[str, ...]]


class SiteModel:
    """Takes records; on the application's loop."""

    def __init__(self, site: ShownSite) -> None:
        self.gen = 1
        self.site = site
        self._facts: dict[str, dict[str, Any]] = {}  # by starter: what it has said of itself
        self._facts_gen: dict[str, int] = {}
        self._latest: dict[str, _Latest] = {}  # by topic, the latest changed last
        self._messages: deque[SiteMessage] = deque(maxlen=MOST_MESSAGES)
        self._results: deque[SiteMessage] = deque(maxlen=MOST_MESSAGES)
        self._records: deque[SiteMessage] = deque()  # starts and trips
        self._record_bytes = 0
        self._plots: dict[str, StarterPlots] = {}
        self._commands: dict[str, OrderedDict[tuple[str, str, str], dict[str, Any]]] = {}  # as for JSON

    def move(self, site: ShownSite) -> None:
        """Show another configuration; what it does not name is forgotten."""
        self.site = site
        self.gen += 1
        for table in (self._facts, self._plots, self._commands):
            for name in [name for name in table if name not in site.starters and name not in site.groups]:
                del table[name]

    def put(self, record: Record, now_s: float) -> None:
        """Take a record: what is retained replaces the one before of its topic, all else has happened."""
        self.gen += 1
        match record:
            case ForgetRecord():
                self._forget(record)
                return
            case HistoryRecord():
                return
            case ValueRecord():
                self._plot(record, now_s)
            case ResultRecord():
                self._note_result(record)
            case AuditRecord() if record.decision == "accepted" or (
                record.decision == "rejected" and record.id
            ):
                command = self._command(record.starter, record.client, record.id, record.verb)
                if command is not None:
                    command |= {"args": record.args, "source": record.source or "mqtt"}
            case InfoRecord():
                self._note_info(record)
            case _:
                pass
        if record.RETAIN:
            self._retain(record)
        else:
            self._note(record)

    def _note(self, record: Record) -> None:
        message = SiteMessage(self.gen, self._placed(record.topic), record.payload())
        match record:
            case StartRecord() | TripRecord():
                self._store_record(message)
            case ResultRecord():
                self._results.append(message)
            case _:
                self._messages.append(message)

    def topics(self, scope: str | None, since: int = 0) -> Iterator[tuple[str, bytes | None]]:
        """Yield what a client of this scope has not seen since a generation, the newest first.

        What no longer exists is None; from the beginning (0) it is left out.
        """
        for topic, latest in reversed(self._latest.items()):
            if latest.gen <= since:
                return
            if (latest.payload is not None or since) and latest.is_for(scope):
                yield topic, latest.payload

    def later(self, scope: str | None) -> Iterator[tuple[str, bytes | None]]:
        """Yield all that a client of this scope is sent, the oldest first, each as it is when it is taken.

        Which topics there are is settled by the first step.
        """
        for topic in [topic for topic, each in self._latest.items() if each.payload and each.is_for(scope)]:
            yield topic, self._latest[topic].payload

    def messages(self, scope: str | None, since: int = 0) -> list[SiteMessage] | None:
        """Return what happened since a generation, oldest first; None when that is no longer known."""
        for ring in (self._messages, self._results):
            if since and len(ring) == MOST_MESSAGES and ring[0].gen > since + 1:
                return None
        found = [message for message in self._messages if message.gen > since]
        if since:
            found += [message for message in self._results if message.gen > since]
            found += [each for each in self._records if each.gen > since and each.place.starter == scope]
        elif scope is not None:
            prefix = f"result/{scope}/"
            found += [each for each in self._results if each.place.name.startswith(prefix)][-MOST_COMMANDS:]
        return sorted(found, key=lambda message: message.gen)

    def facts(self, starter: str) -> dict[str, Any]:
        """Return what is known of a starter besides its readings."""
        groups = [name for name, members in self.site.groups.items() if starter in members]
        return {**self.site.starters[starter], "groups": groups, **self._facts.get(starter, {})}

    def facts_since(self, since: int) -> dict[str, dict[str, Any]]:
        """Return the facts of starters that have changed since a generation."""
        return {
            name: self.facts(name)
            for name, gen in self._facts_gen.items()
            if gen > since and name in self.site.starters
        }

    def raw(self, name: str) -> bytes | None:
        """Return the newest payload of a topic below the base as it is; None when there is none."""
        latest = self._latest.get(name)
        return None if latest is None else latest.payload

    def payload(self, name: str) -> dict[str, Any] | None:
        """Return the newest payload of a topic below the base; None when there is none."""
        payload = self.raw(name)
        return None if payload is None else dict(json.loads(payload))

    def plots(self, starter: str) -> StarterPlots | None:
        """Return a starter's plots; None while none of its quantities was read."""
        return self._plots.get(starter)

    def voltage_point(self, starter: str) -> str:
        """Return which voltage is plotted; empty when it has none."""
        names = (f"starter/{starter}/value/{point}" for point in _VOLTAGES)
        return next((name.rpartition("/")[2] for name in names if name in self._latest), "")

    def is_target(self, name: str) -> bool:
        """Return whether a command may name it: a starter, or a group."""
        return name in self.site.starters or name in self.site.groups

    def commands(self, starter: str) -> list[dict[str, Any]]:
        """Return a starter's last commands, oldest first."""
        return [dict(command) for command in self._commands.get(starter, {}).values()]

    def records(self, starter: str, kind: str) -> list[bytes]:
        """Return the payloads of a starter's last starts or trips, oldest first."""
        name = f"starter/{starter}/{kind}"
        return [each.payload for each in self._records if each.place.name == name]

    def _retain(self, record: Record) -> None:
        topic = record.topic
        latest = self._latest.pop(topic, None)
        if latest is None:
            place = self._placed(topic)
            latest = _Latest(self.gen, b"", place.starter, place.is_overview)
        latest.gen, latest.payload = self.gen, record.payload()
        self._latest[topic] = latest

    def _forget(self, record: ForgetRecord) -> None:
        for topic in [topic for topic in self._latest if record.has(topic)]:
            latest = self._latest[topic] = self._latest.pop(topic)
            latest.gen, latest.payload = self.gen, None

    def _placed(self, name: str) -> TopicPlace:
        levels = name.split("/")
        if levels[0] != "starter" or len(levels) < 2:
            return TopicPlace(name, "", is_overview=True)
        kind = levels[2] if len(levels) > 2 else ""
        is_overview = kind in _OVERVIEW or (kind == "value" and levels[3] in _OVERVIEW_VALUES)
        return TopicPlace(name, sys.intern(levels[1]), is_overview)

    def _store_record(self, message: SiteMessage) -> None:
        same = [each for each in self._records if each.place == message.place]
        if len(same) >= MOST_RECORDS:
            self._forget_record(same[0])
        self._records.append(message)
        self._record_bytes += len(message.payload)
        while self._record_bytes > MOST_RECORD_BYTES:
            self._forget_record(self._records[0])

    def _forget_record(self, message: SiteMessage) -> None:
        self._records.remove(message)
        self._record_bytes -= len(message.payload)

    def _plot(self, record: ValueRecord, now_s: float) -> None:
        if record.point != "current" and record.point not in _VOLTAGES:
            return
        plots = self._plots.get(record.starter)
        if plots is None:
            plots = self._plots[record.starter] = StarterPlots()
        is_known = record.quality is Quality.GOOD and isinstance(record.value, (int, float))
        value = float(record.value or 0.0) if is_known else NAN
        if record.point == "current":
            plots.put_current(value, now_s)
        elif record.point == self.voltage_point(record.starter) or record.point == _VOLTAGES[0]:
            plots.voltage.put(value, now_s)

    def _note_info(self, record: InfoRecord) -> None:
        said = {name: getattr(record, name) for name in _FACTS}
        self._facts[record.starter] = {name: value for name, value in said.items() if value is not None}
        self._facts_gen[record.starter] = self.gen

    def _note_result(self, record: ResultRecord) -> None:
        command = self._command(record.starter, record.client, record.id, record.verb)
        if command is not None:
            phase = {
                "phase": str(record.phase),
                "code": record.code,
                "text": record.text,
                "time": rfc3339(record.time_s),
            }
            command["phases"] = [*command["phases"][-7:], phase]

    def _command(self, starter: str, client: str, id_: str | None, verb: str) -> dict[str, Any] | None:
        """Return the record of a command to a starter or group that there is; one without id by its verb."""
        if not self.is_target(starter):
            return None
        commands = self._commands.setdefault(starter, OrderedDict())
        key = client, id_ or "", verb
        command = commands.get(key)
        phases = command["phases"] if command is not None else []
        if not id_ and phases and Phase(phases[-1]["phase"]).is_final:
            commands[client, f"ended {self.gen}", verb] = commands.pop(key)  # one without id is over
            command = None
        if command is None:
            command = {"id": id_, "client": client, "verb": verb, "args": {}, "source": "mqtt", "phases": []}
            commands[key] = command
            while len(commands) > MOST_COMMANDS:
                commands.popitem(last=False)
        return command
