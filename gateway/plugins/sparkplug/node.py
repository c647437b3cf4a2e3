"""The edge node between two looks at the socket: which message is next, and with which number; pure.

1. A message gets its `seq` when it is taken to be written, never before: nothing with a number is dropped.
2. A birth is made of the newest values when it is taken, so it never waits as bytes.
3. Changes wait, at most `GATHER_S` a starter, and go out together in the order of their times. Beyond
   `MOST_CHANGES` that wait all of them are replaced by a new birth of everything.
4. A rebirth is honoured at once when there was none for `REBIRTH_EVERY_S`, else as soon as that has passed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import inf

from gateway.contract import LineRecord, Record
from gateway.mqtt.message import Message
from gateway.plugins.sparkplug.metrics import NodeMetrics, StarterMetrics
from gateway.plugins.sparkplug.payload import FALSE, DataType, Metric, Value, encoded
from gateway.plugins.sparkplug.topics import BD_SEQ, REBIRTH, EdgeTopics
from gateway.starters.policy.rights import Rights

GATHER_S = 0.25
REBIRTH_EVERY_S = 5.0
MOST_CHANGES = 20_000  # metrics; 247 starters make some 5000 a second at most
SEQ_NUMBERS = 256  # 0 to 255 [tck-id-payloads-sequence-num-incrementing]


class _Unsaid:
    """What one device, or the node itself, still has to say."""

    def __init__(self) -> None:
        self.is_born = False
        self.owes_death = False
        self.edition = 0  # of the metrics that its birth has named
        self.changes: list[Metric] = []
        self.sent_s = -inf

    def due_s(self, now_s: float) -> float:
        return max(now_s, self.sent_s + GATHER_S)


class _Device(_Unsaid):
    def __init__(self, metrics: StarterMetrics) -> None:
        super().__init__()
        self.metrics = metrics

    @property
    def is_to_be_born(self) -> bool:
        is_alive = self.metrics.is_known and self.metrics.is_answering
        return is_alive and (not self.is_born or self.edition != self.metrics.table.edition)


class EdgeNode:
    """One edge node with its devices. `now_s` is the steady clock, `utc_s` the wall's.

    `since_s`, UTC: when the gateway began, before anything was read.
    """

    def __init__(
        self,
        topics: EdgeTopics,
        node: NodeMetrics,
        starters: Collection[str],
        *,
        since_s: float,
        operator: str | None,
        rights: Rights,
        has_datatypes: bool = False,
    ) -> None:
        self.topics = topics
        self._own = node
        self._since_s = since_s
        self._operator = operator
        self._rights = rights
        self._has_datatypes = has_datatypes
        self._devices: dict[str, _Device] = {}
        self._gone: dict[str, _Device] = {}  # configured no more, death not yet published
        self._node = _Unsaid()
        self._owing: dict[str, None] = {}  # devices with a birth or death to publish, the oldest first
        self._dues: dict[str, float] = {}  # devices with changes: when they go out
        self._node_due_s = inf
        self._waiting = 0  # changes
        self._bd_seq: int | None = None  # None: no connection
        self._seq = 0
        self._rebirth_s = inf  # when the next one is due
        self._last_rebirth_s = -inf
        self.is_permitted = True  # by the primary host
        self.born_utc_s: float | None = None  # the first birth of this connection; None: none was published
        self.due_s = inf  # when `take` may have something; at most that late
        self.move(starters)

    @property
    def is_born(self) -> bool:
        """Return whether this connection's birth was published."""
        return self._node.is_born

    def has(self, starter: str) -> bool:
        """Return whether a starter is one of the devices."""
        return starter in self._devices

    def move(self, starters: Collection[str]) -> None:
        """Have these starters as devices; what is gone dies, what is new is born once it answers."""
        for name in [name for name in self._devices if name not in starters]:
            device = self._devices.pop(name)
            self._owing.pop(name, None)
            self._dues.pop(name, None)
            if device.is_born or device.owes_death:
                self._gone[name] = device
                self.due_s = -inf
        for name in starters:
            if name not in self._devices:
                self._devices[name] = _Device(
                    StarterMetrics(since_s=self._since_s, operator=self._operator, rights=self._rights)
                )

    def move_lines(self, lines: tuple[str, ...]) -> None:
        """Have the metrics of these lines; another set needs a birth of the node."""
        edition = self._own.table.edition
        self._own.move(lines)
        if self._own.table.edition != edition:
            self._begin_births()

    def begin(self, bd_seq: int) -> None:
        """Begin a connection: subscribed, nothing published yet."""
        self._bd_seq = bd_seq
        self.born_utc_s = None
        self._rebirth_s, self._last_rebirth_s = inf, -inf
        self._begin_births()

    def end(self) -> None:
        """End the connection: nothing is taken until the next one."""
        self._bd_seq = None
        self.born_utc_s = None
        self._begin_births()
        self._gone.clear()
        self.due_s = inf

    def permit(self, *, is_permitted: bool) -> None:
        """Publish only while the primary host is online; its return means new births."""
        if is_permitted != self.is_permitted:
            self.is_permitted = is_permitted
            self._begin_births()

    def request_rebirth(self, now_s: float) -> None:
        """Honour a host's request, at once or as soon as the last one is `REBIRTH_EVERY_S` ago."""
        due_s = max(now_s, self._last_rebirth_s + REBIRTH_EVERY_S)
        self._rebirth_s = min(self._rebirth_s, due_s)
        self.due_s = min(self.due_s, due_s)

    def put(self, record: Record, *, now_s: float, utc_s: float) -> None:
        """Take a record, in order."""
        if isinstance(record, LineRecord):
            self._note_node(self._own.take(record, utc_s), now_s)
            return
        name = getattr(record, "starter", "")
        device = self._devices.get(name)
        if device is not None:
            self._note(name, device, device.metrics.take(record, utc_s), now_s)

    def note(self, facts: Mapping[str, Value], *, now_s: float, utc_s: float) -> None:
        """Take what the gateway says of itself."""
        self._note_node(self._own.note(facts, utc_s), now_s)

    def command_done(self, starter: str, name: str, *, now_s: float, utc_s: float) -> None:
        """Show a command's metric as false again."""
        device = self._devices.get(starter)
        if device is not None:
            self._note(starter, device, device.metrics.command_done(name, utc_s), now_s)

    def take(self, *, now_s: float, utc_s: float) -> Message | None:
        """Return the next message, which must be written to the socket now; None when there is none yet."""
        if self._bd_seq is None or not self.is_permitted:
            self.due_s = inf
            return None
        message = self._next(now_s, utc_s)
        self.due_s = -inf if message is not None else self._next_due_s()
        return message

    def death(self, bd_seq: int, utc_s: float) -> Message:
        """Return an NDEATH, the will of the connection with this number [tck-id-topics-ndeath-payload]."""
        metrics = [Metric(BD_SEQ, DataType.INT64, bd_seq, utc_s)]
        payload = encoded(metrics, time_s=utc_s, seq=None)
        return Message(self.topics.of("NDEATH"), payload, qos=1, retain=False)

    def _next(self, now_s: float, utc_s: float) -> Message | None:
        if now_s >= self._rebirth_s:
            self._last_rebirth_s, self._rebirth_s = now_s, inf
            self._begin_births()
        if not self._node.is_born:
            return self._node_birth(now_s, utc_s)
        for name, device in self._gone.items():
            del self._gone[name]
            return self._death_of(name, device, utc_s)
        for name in tuple(self._owing):
            message = self._owed(name, self._devices[name], now_s, utc_s)
            if message is not None:
                return message
        if now_s >= self._node_due_s:
            changes = self._taken(self._node, now_s)
            self._node_due_s = inf
            return self._message("NDATA", None, changes, utc_s)
        for name, due_s in self._dues.items():
            if now_s >= due_s:
                return self._data(name, self._devices[name], now_s, utc_s)
        return None

    def _owed(self, name: str, device: _Device, now_s: float, utc_s: float) -> Message | None:
        """Return a device's death, or birth; before its death what it still had to say."""
        if device.owes_death:
            if device.changes:
                return self._data(name, device, now_s, utc_s)
            return self._death_of(name, device, utc_s)
        del self._owing[name]
        if not device.is_to_be_born:
            return None
        self._dues.pop(name, None)
        self._taken(device, now_s)
        device.is_born, device.edition = True, device.metrics.table.edition
        return self._message("DBIRTH", name, device.metrics.table.birth(), utc_s, has_datatypes=True)

    def _death_of(self, name: str, device: _Device, utc_s: float) -> Message:
        self._dues.pop(name, None)
        self._waiting -= len(device.changes)
        device.changes = []
        device.is_born = device.owes_death = False
        return self._message("DDEATH", name, (), utc_s)

    def _data(self, name: str, device: _Device, now_s: float, utc_s: float) -> Message:
        self._dues.pop(name, None)
        return self._message("DDATA", name, self._taken(device, now_s), utc_s)

    def _node_birth(self, now_s: float, utc_s: float) -> Message:
        self._node.is_born = True
        self._taken(self._node, now_s)
        self._node_due_s = inf
        if self.born_utc_s is None:
            self.born_utc_s = utc_s
        self._seq = SEQ_NUMBERS - 1  # so that this one is 0
        metrics = [
            Metric(BD_SEQ, DataType.INT64, self._bd_seq, utc_s),
            Metric(REBIRTH, DataType.BOOLEAN, FALSE, utc_s),
            *self._own.table.birth(),
        ]
        return self._message("NBIRTH", None, metrics, utc_s, has_datatypes=True)

    def _message(
        self,
        kind: str,
        device: str | None,
        metrics: Collection[Metric],
        utc_s: float,
        *,
        has_datatypes: bool | None = None,
    ) -> Message:
        self._seq = (self._seq + 1) % SEQ_NUMBERS
        has_types = self._has_datatypes if has_datatypes is None else has_datatypes
        payload = encoded(metrics, time_s=utc_s, seq=self._seq, has_datatypes=has_types)
        return Message(self.topics.of(kind, device), payload, qos=0, retain=False)

    def _taken(self, source: _Unsaid, now_s: float) -> list[Metric]:
        changes, source.changes, source.sent_s = source.changes, [], now_s
        self._waiting -= len(changes)
        return changes

    def _note(self, name: str, device: _Device, changes: list[Metric], now_s: float) -> None:
        """Have changes go out, or the death or birth that follows from a record."""
        if not self._node.is_born:
            return  # its birth will say everything
        if device.is_born and not device.metrics.is_answering and not device.owes_death:
            device.owes_death = True
            self._owe(name)
        elif device.is_to_be_born:
            self._owe(name)
        elif changes and device.is_born and not device.owes_death:
            device.changes += changes
            self._waiting += len(changes)
            due_s = self._dues.setdefault(name, device.due_s(now_s))
            self.due_s = min(self.due_s, due_s)
            self._limit()

    def _note_node(self, changes: list[Metric], now_s: float) -> None:
        if not self._node.is_born or not changes:
            return
        self._node.changes += changes
        self._waiting += len(changes)
        self._node_due_s = min(self._node_due_s, self._node.due_s(now_s))
        self.due_s = min(self.due_s, self._node_due_s)
        self._limit()

    def _limit(self) -> None:
        """Begin anew where the connection takes less than there is to say."""
        if self._waiting > MOST_CHANGES:
            self._begin_births()

    def _owe(self, name: str) -> None:
        self._owing[name] = None
        self.due_s = -inf

    def _begin_births(self) -> None:
        self._node.is_born = False
        self._node.changes.clear()
        self._node_due_s = inf
        self._dues.clear()
        self._waiting = 0
        for device in self._devices.values():
            device.is_born = device.owes_death = False
            device.changes = []
        self._owing = dict.fromkeys(self._devices)
        self.due_s = -inf

    def _next_due_s(self) -> float:
        return min(self._rebirth_s, self._node_due_s, min(self._dues.values(), default=inf))
