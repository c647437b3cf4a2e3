"""What earlier runs left retained at the broker, and whether another gateway publishes below the same base.

1. On its first connection a run reads what is stored below `gateway` and `starter`, until a token of its own
   (`gateway/fresh`) comes back: what was stored came before it. Only then is the gateway online.
2. Starters and lines that are not configured are cleared at once, and values of points that a starter no
   longer has, since a run begins with all its points; an alarm that an earlier run left active,
   once its starter was read in this run and did not show it.
3. Only that is cleared whose topic and fields are those of the contract, and nothing while another gateway is
   there. Its heartbeat shows that, or a status that comes now; a stored status may be that of a gateway
   that died with its broker.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Protocol

from gateway.contract import (
    LINE,
    EventCode,
    FreshRecord,
    PublishEvent,
    Quality,
    Record,
    RetainedTopic,
    StateRecord,
    StatusRecord,
    Topics,
    read_object,
)
from gateway.mqtt.commands import Incoming
from gateway.starters import Tokens
from gateway.system.rate_limits import HoldOff

log = logging.getLogger(__name__)

WITHIN_S = 10.0  # after the connection: online at the latest
HEARTBEAT_S = 3.0  # so long a doubtful status waits for its gateway's heartbeat, which comes each second
SETTLED_S = 3.0  # after a starter's first state: a fault's number is published by then
QUIET_S = 60.0  # without a sign of the other gateway, before it is reported again
VALUE, ALARM = "value", "alarm"

_FIELDS: Mapping[str, frozenset[str]] = {
    "info": frozenset({"family", "model", "line", "address", "points", "commands"}),
    "availability": frozenset({"state", "since", "reason"}),
    "state": frozenset({"state", "quality", "time", "seq"}),
    VALUE: frozenset({"value", "unit", "quality", "time", "seq"}),
    ALARM: frozenset({"active", "severity", "text", "time", "cleared", "count"}),
    LINE: frozenset({"utilisation", "polls", "answered", "silent"}),
}


class ReadConnection(Protocol):
    """The part of a connection that is used here."""

    def read(self, topic_filter: str, on_answer: Callable[[bool], None]) -> None:
        """Have what is stored on these topics, as retained, and what comes."""

    def unread(self, topic_filter: str) -> None:
        """Have no more of it."""


class Leftovers:
    """Of one run; a subscriber of the records. `on_read` is called once, when the gateway may be online.

    `is_current` says whether a topic's starter or line is configured, `is_published` whether this run has
    published on a topic; `clear` makes the broker forget one.
    """

    takes = (StateRecord,)

    def __init__(
        self,
        topics: Topics,
        tokens: Tokens,
        *,
        is_current: Callable[[RetainedTopic], bool],
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
        self._branches = (f"{topics.base}/gateway/#", f"{topics.base}/starter/#")
        self._reading: asyncio.Task[None] | None = None
        self._is_answered = asyncio.Event()  # the reading has come to its end, or was refused
        self._is_shared = asyncio.Event()
        self._is_judged = asyncio.Event()  # no alarm waits for its starter
        self._is_refused = False
        self._is_doubtful = False  # another's status is stored
        self._may_clear = False  # everything is read, and nothing is doubtful
        self._gone: set[str] = set()  # topics of starters, lines and points that are no more
        self._alarms: dict[str, set[str]] = {}  # topics, by starter, that were left active
        self._seen: set[str] = set()  # starters that were read in this run
        self._settled: set[str] = set()  # those whose faults and alarms are published
        self._sharing = HoldOff(QUIET_S)
        self.is_read = False

    def connected(self, connection: ReadConnection) -> None:
        """Watch for another gateway, and read what is stored unless that has been done in this run."""
        for topic in (self._topics.of(StatusRecord), self._topics.of(FreshRecord)):
            connection.read(topic, _ignore)
        if self.is_read:
            return
        self._is_answered.clear()
        self._is_refused = self._is_doubtful = self._may_clear = False
        for branch in self._branches:
            connection.read(branch, self._note_answer)
        self._reading = asyncio.create_task(self._read(connection), name="leftovers")

    def disconnected(self) -> None:
        """Stop reading; the next connection begins again."""
        if self._reading is not None:
            self._reading.cancel()
            self._reading = None

    def take(self, incoming: Incoming) -> None:
        """Take a message on a topic of this gateway's own; what is stored is marked as retained."""
        if incoming.topic == self._topics.of(FreshRecord):
            self._take_heartbeat(incoming)
        elif incoming.topic == self._topics.of(StatusRecord):
            self._take_status(incoming)
        elif incoming.is_retained and self._reading is not None:
            self._take_stored(incoming)

    def put(self, record: Record) -> None:
        """Note that a starter was read."""
        if not isinstance(record, StateRecord) or record.starter in self._seen:
            return
        if record.quality is Quality.GOOD:
            self._seen.add(record.starter)
            asyncio.get_running_loop().call_later(SETTLED_S, self._settle, record.starter)

    def _take_heartbeat(self, incoming: Incoming) -> None:
        if incoming.is_retained:
            return
        token = _fields_of(incoming).get("token")
        if not isinstance(token, str):
            return  # somebody has cleared the topic
        if self._tokens.has_made(token):
            self._is_answered.set()
        else:
            self._note_sharing()

    def _take_status(self, incoming: Incoming) -> None:
        fields = _fields_of(incoming)
        run = fields.get("run", self._tokens.boot.run)
        if run == self._tokens.boot.run or fields.get("state") == "offline":
            return
        if incoming.is_retained:
            self._is_doubtful = True
        else:
            self._note_sharing()

    def _take_stored(self, incoming: Incoming) -> None:
        found = self._topics.parse_retained(incoming.topic)
        if found is None:
            return
        is_left = not self._is_current(found) or found.kind == VALUE
        if not (is_left or found.kind == ALARM) or self._is_published(incoming.topic):
            return
        fields = _fields_of(incoming)
        if not fields.keys() >= _FIELDS[found.kind]:
            return
        if is_left:
            self._gone.add(incoming.topic)
        elif fields["active"] and fields.get("boot") != self._tokens.boot.run:
            self._alarms.setdefault(found.name, set()).add(incoming.topic)

    def _note_answer(self, is_permitted: bool) -> None:  # noqa: FBT001 - the callback's shape
        if not is_permitted:
            self._is_refused = True
            self._is_answered.set()

    def _note_sharing(self) -> None:
        """Report that another gateway is there; what it keeps retained is not to be cleared."""
        self._is_shared.set()
        if self._sharing.sounds(asyncio.get_running_loop().time()):
            self._publish_event(EventCode.BASE_SHARED, base=self._topics.base)

    async def _read(self, connection: ReadConnection) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(WITHIN_S):
                await self._is_answered.wait()
                if self._is_doubtful:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(HEARTBEAT_S):
                            await self._is_shared.wait()
                self._may_clear = True
                self._clear_all(self._gone)
                self._judge()
                await self._is_judged.wait()
        self._reading = None
        for branch in self._branches:
            connection.unread(branch)
        if self._is_refused or not self._is_answered.is_set():
            branches = list(self._branches)
            self._publish_event(EventCode.LEFTOVERS_UNREAD, topics=branches, branches=" and ".join(branches))
        self.is_read = True
        self._on_read()

    def _settle(self, starter: str) -> None:
        self._settled.add(starter)
        if self._may_clear:
            self._judge()

    def _judge(self) -> None:
        """Clear alarms that ended while no gateway ran, of the starters that have been read since."""
        for starter in self._alarms.keys() & self._settled:
            self._clear_all(self._alarms.pop(starter))
        if not self._alarms or self._is_shared.is_set():
            self._is_judged.set()

    def _clear_all(self, topics: set[str]) -> None:
        left = sorted(topic for topic in topics if not self._is_published(topic))
        if not left or self._is_shared.is_set():
            return
        for topic in left:
            self._clear(topic)
        log.info("topics=%d left by earlier runs cleared, the first is %s", len(left), left[0])


def _fields_of(incoming: Incoming) -> dict[str, Any]:
    try:
        return read_object(incoming.payload)
    except ValueError:
        return {}


def _ignore(_: bool) -> None:  # noqa: FBT001 - the callback's shape
    """Do nothing: the answer to the whole branch says it."""
