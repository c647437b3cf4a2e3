"""What earlier runs left retained at the broker, and whether another gateway publishes below the same base.

1. On its first connection a run reads what is stored below `gateway` and `starter`, until a token of its own
   (`gateway/fresh`) comes back: what was stored came before it. Only then is the gateway online.
2. What this run has not published is cleared: at once where the starter or line is not configured, and values
   of points that a starter no longer has, since a run begins with all its points; an active alarm once its
   starter was read in this run and did not show it. Only records of the contract are.
3. Nothing is cleared while another gateway is there. Its heartbeat shows that, or a status that comes now; a
   stored status may be that of a gateway that died with its broker.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    EventCode,
    FreshRecord,
    InfoRecord,
    LineRecord,
    PublishEvent,
    Quality,
    Record,
    StateRecord,
    StatusRecord,
    Topics,
    ValueRecord,
    read_object,
)
from gateway.mqtt.commands import Incoming
from gateway.starters import Tokens
from gateway.system.rate_limits import HoldOff
from gateway.system.supervised import is_set_within

log = logging.getLogger(__name__)

WITHIN_S = 10.0  # after the connection: online at the latest
HEARTBEAT_S = 3.0  # so long a doubtful status waits for its gateway's heartbeat, which comes each second
SETTLED_S = 3.0  # after a starter's first state: a fault's number is published by then
QUIET_S = 60.0  # without a sign of the other gateway, before it is reported again

_FIELDS: Mapping[type[Record], set[str]] = {  # by which a record is known; whatever else is stored stays
    InfoRecord: {"family", "model", "line", "address", "points", "commands"},
    AvailabilityRecord: {"state", "since", "reason"},
    StateRecord: {"state", "quality", "time", "seq"},
    ValueRecord: {"value", "unit", "quality", "time", "seq"},
    AlarmRecord: {"active", "severity", "text", "time", "cleared", "count"},
    LineRecord: {"utilisation", "polls", "answered", "silent"},
}


class ReadConnection(Protocol):
    """The part of a connection that is used here."""

    def read(self, topic_filter: str, on_answer: Callable[[bool], None]) -> None:
        """Have what is stored on these topics, as retained, and what comes."""

    def unlisten(self, topic: str) -> None:
        """End the subscription."""


class Leftovers:
    """The retained messages of earlier runs; a subscriber of the records.

    `is_current` says whether the starter or line that a topic names is configured, `is_published` whether
    this run has published on a topic; `clear` makes the broker forget one. `on_read` is called once, when the
    gateway may be online.
    """

    takes = (StateRecord,)

    def __init__(
        self,
        topics: Topics,
        tokens: Tokens,
        *,
        is_current: Callable[[Mapping[str, str]], bool],
        is_published: Callable[[str], bool],
        clear: Callable[[str], None],
        publish_event: PublishEvent,
        on_read: Callable[[], None],
    ) -> None:
        self._topics = topics
        self._tokens = tokens
        self._is_current = is_current
        self._is_published = is_published
        self._clear = clear
        self._publish_event = publish_event
        self._on_read = on_read
        self._branches = [f"{topics.base}/gateway/#", f"{topics.base}/starter/#"]
        self._reading = _Reading()
        self._task: asyncio.Task[None] | None = None
        self._settled: dict[str, bool] = {}  # starters read in this run: whether their alarms are published
        self._is_shared = asyncio.Event()
        self._sharing = HoldOff(QUIET_S)
        self.is_read = False

    def connected(self, connection: ReadConnection) -> None:
        """Watch for another gateway, and read what is stored unless that has been done in this run."""
        for topic in (self._topics.of(StatusRecord), self._topics.of(FreshRecord)):
            connection.read(topic, lambda _: None)  # the answer to the whole branch says it
        if self.is_read:
            return
        self._reading = _Reading()
        for branch in self._branches:
            connection.read(branch, self._reading.note_answer)
        self._task = asyncio.create_task(self._read(connection, self._reading), name="leftovers")

    def disconnected(self) -> None:
        """Stop reading; the next connection begins again."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def take(self, incoming: Incoming) -> None:
        """Take a message on a topic of this gateway's own; what is stored is marked as retained."""
        if incoming.topic == self._topics.of(FreshRecord):
            self._take_heartbeat(incoming)
        elif incoming.topic == self._topics.of(StatusRecord):
            self._take_status(incoming)
        elif incoming.is_retained and self._task is not None:
            self._take_stored(incoming)

    def put(self, record: Record) -> None:
        """Note that a starter was read."""
        if not isinstance(record, StateRecord) or record.starter in self._settled:
            return
        if record.quality is Quality.GOOD:
            self._settled[record.starter] = False
            asyncio.get_running_loop().call_later(SETTLED_S, self._settle, record.starter)

    def _take_heartbeat(self, incoming: Incoming) -> None:
        token = _fields_of(incoming).get("token")
        if incoming.is_retained or not isinstance(token, str):
            return  # it is old, or somebody has cleared the topic
        if self._tokens.has_made(token):
            self._reading.is_ended.set()
        else:
            self._note_sharing()

    def _take_status(self, incoming: Incoming) -> None:
        fields = _fields_of(incoming)
        run = fields.get("run", self._tokens.run)
        if run == self._tokens.run or fields.get("state") == "offline":
            return
        if incoming.is_retained:
            self._reading.is_doubtful = True
        else:
            self._note_sharing()

    def _take_stored(self, incoming: Incoming) -> None:
        topic, fields = incoming.topic.removeprefix(f"{self._topics.base}/"), _fields_of(incoming)
        for kind, own in _FIELDS.items():
            names = kind.names_of(topic)
            if names is None or not fields.keys() >= own:
                continue
            if kind is ValueRecord or not self._is_current(names):
                self._reading.left[incoming.topic] = ""
            elif kind is AlarmRecord and fields["active"]:
                self._reading.left[incoming.topic] = names["starter"]

    def _note_sharing(self) -> None:
        """Report that another gateway is there; what it keeps retained is not to be cleared."""
        self._is_shared.set()
        if self._sharing.sounds(asyncio.get_running_loop().time()):
            self._publish_event(EventCode.BASE_SHARED, base=self._topics.base)

    async def _read(self, connection: ReadConnection, reading: _Reading) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(WITHIN_S):
                await reading.is_ended.wait()
                if reading.is_doubtful:
                    await is_set_within(self._is_shared, HEARTBEAT_S)
                reading.may_clear = True
                self._clear_left()
                await reading.is_judged.wait()
        self._task = None
        for branch in self._branches:
            connection.unlisten(branch)
        if reading.is_refused or not reading.is_ended.is_set():
            branches = " and ".join(self._branches)
            self._publish_event(EventCode.LEFTOVERS_UNREAD, topics=self._branches, branches=branches)
        self.is_read = True
        self._on_read()

    def _settle(self, starter: str) -> None:
        self._settled[starter] = True
        if self._reading.may_clear:
            self._clear_left()

    def _clear_left(self) -> None:
        """Clear all that waits for no starter, or for one that has been read in this run."""
        left = self._reading.left
        if self._is_shared.is_set():
            left.clear()
        ready = [topic for topic, starter in left.items() if self._settled.get(starter, not starter)]
        for topic in ready:
            del left[topic]
        unpublished = sorted(topic for topic in ready if not self._is_published(topic))
        for topic in unpublished:
            self._clear(topic)
        if unpublished:
            log.info("topics=%d left by earlier runs cleared, first %s", len(unpublished), unpublished[0])
        if not left:
            self._reading.is_judged.set()


@dataclass(slots=True)
class _Reading:
    """What one connection has read of the stored messages."""

    is_ended: asyncio.Event = field(default_factory=asyncio.Event)  # everything was read, or refused
    is_judged: asyncio.Event = field(default_factory=asyncio.Event)  # nothing is left to be cleared
    is_refused: bool = False
    is_doubtful: bool = False  # another's status is stored
    may_clear: bool = False  # everything is read, and nothing is doubtful
    left: dict[str, str] = field(default_factory=dict)  # topics, with the starter to be read first; "": none

    def note_answer(self, is_permitted: bool) -> None:  # noqa: FBT001 - the callback's shape
        if not is_permitted:
            self.is_refused = True
            self.is_ended.set()


def _fields_of(incoming: Incoming) -> dict[str, Any]:
    try:
        return read_object(incoming.payload)
    except ValueError:
        return {}
