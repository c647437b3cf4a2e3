"""The edge node between two looks at the socket: which message is next, and with which number; pure.

1. A message gets its `seq` when it is taken to be written, never before: nothing with a number is dropped.
2. It is made then, of the newest records: so neither a birth nor a change ever waits as bytes, and what waits
   is never more than the topics that have changed.
3. Changes are gathered for at most `GATHER_S` a starter, and go out together in the order of their times.
   Values that hosts know already are not sent again.
4. A rebirth is honoured at once when there was none for `REBIRTH_EVERY_S`, else as soon as that has passed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from math import inf

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    InfoRecord,
    Latest,
    LineRecord,
    Record,
    StateRecord,
    ValueRecord,
)
from gateway.mqtt import Message
from gateway.plugins.sparkplug.metrics import MetricFact, alarm_facts, defined, described, facts_of, filled
from gateway.plugins.sparkplug.payload import (
    BAD,
    FALSE,
    GOOD,
    DataType,
    Metric,
    Value,
    decoded_command,
    encoded,
)
from gateway.plugins.sparkplug.settings import BD_SEQ, REBIRTH, SEQ_NUMBERS, SparkplugSettings

GATHER_S = 0.25
REBIRTH_EVERY_S = 5.0
ANSWERING = frozenset({"online", "degraded"})
OF_LINES = ("utilisation", "sweep_s")


class _KnownMetric:
    """The values of the node itself, or of a device, that hosts know since its birth."""

    def __init__(self) -> None:
        self.known: dict[str, tuple[Value, int | None]] = {}
        self.is_born = False
        self.sent_s = -inf

    def born(self, metrics: Mapping[str, Metric], now_s: float) -> Collection[Metric]:
        self.is_born, self.sent_s = True, now_s
        self.known = {name: (metric.value, metric.quality) for name, metric in metrics.items()}
        return metrics.values()

    def news(self, metrics: Iterable[Metric], now_s: float) -> list[Metric]:
        """Return what hosts do not know yet; a value that is good again says so, once."""
        found = []
        for metric in metrics:
            before = self.known.get(metric.name)
            if before == (metric.value, metric.quality):
                continue
            self.known[metric.name] = metric.value, metric.quality
            is_good_again = metric.quality is None and before is not None and before[1] is not None
            quality = GOOD if is_good_again else metric.quality
            found.append(replace(metric, quality=quality, properties=()))
        self.sent_s = now_s if found else self.sent_s
        return found


class _Device(_KnownMetric):
    """A starter; `since_s`: what is not known of it yet is dated so."""

    def __init__(self, name: str, latest: Latest, *, since_s: float) -> None:
        super().__init__()
        self._latest = latest
        self._name = name
        self._since_s = since_s
        self._info_topic = InfoRecord.topic_of(starter=name)
        self._availability_topic = AvailabilityRecord.topic_of(starter=name)
        self._points: Collection[str] = ()
        self._metrics: dict[str, Metric] = {}  # as they are before anything was read
        self._is_renamed = False  # since its birth
        self._alarms: dict[str, None] = {}  # topics
        self._changed: dict[str, None] = {}  # topics whose news hosts do not know
        self._answers: dict[str, MetricFact] = {}  # `Command/*`

    @property
    def is_alive(self) -> bool:
        """Return whether it answers, and what it is is known."""
        availability = self._latest.find(self._availability_topic)
        is_answering = isinstance(availability, AvailabilityRecord) and availability.state in ANSWERING
        return bool(self._metrics) and is_answering

    @property
    def is_urgent(self) -> bool:
        return self.is_to_be_born or self.is_born != self.is_alive

    @property
    def is_to_be_born(self) -> bool:
        return self.is_alive and (self._is_renamed or not self.is_born)

    def note(self, topic: str, record: Record | None, settings: SparkplugSettings) -> None:
        """Note that this is the newest record of a topic now."""
        self._changed[topic] = None
        if isinstance(record, AlarmRecord):
            self._alarms[topic] = None
        elif isinstance(record, InfoRecord):
            before, self._points = self._metrics, record.points
            self._metrics = described(record, settings, since_s=self._since_s)
            self._is_renamed |= _types(self._metrics) != _types(before)

    def answer(self, facts: Iterable[MetricFact]) -> None:
        """Show the outcome of a host's command, even if it is as before."""
        answers = {fact.name: fact for fact in facts}
        self._answers |= answers
        for name in answers:
            self.known.pop(name, None)

    def birth(self, now_s: float) -> Collection[Metric]:
        values = [ValueRecord.topic_of(starter=self._name, point=point) for point in self._points]
        own = [self._info_topic, self._availability_topic, StateRecord.topic_of(starter=self._name)]
        self._changed.clear()
        self._is_renamed = False
        known = filled(self._metrics, self._facts([*own, *values, *self._alarms]))
        return self.born(self._metrics | {metric.name: metric for metric in known}, now_s)

    def data(self, now_s: float) -> list[Metric]:
        changed, self._changed = self._changed, {}
        return self.news(filled(self._metrics, self._facts(changed)), now_s)

    def _facts(self, topics: Collection[str]) -> Iterator[MetricFact]:
        for topic in topics:
            yield from facts_of(self._latest.find(topic))
        if not self._alarms.keys().isdisjoint(topics):
            alarms = [self._latest.find(topic) for topic in self._alarms]
            yield from alarm_facts(alarm for alarm in alarms if isinstance(alarm, AlarmRecord))
        yield from self._answers.values()


def _types(metrics: Mapping[str, Metric]) -> dict[str, DataType]:
    return {name: metric.datatype for name, metric in metrics.items()}


class EdgeNode:
    """One edge node with its devices. `now_s` is the steady clock, `utc_s` the wall's.

    `properties` never change; `since_s`, UTC: when the gateway began, before anything was read.
    """

    def __init__(
        self, settings: SparkplugSettings, latest: Latest, *, properties: Mapping[str, str], since_s: float
    ) -> None:
        self._settings = settings
        self._latest = latest
        self._seen = 0  # the number of the latest change that was looked at
        self._facts: dict[str, Value] = {**properties}
        self._since_s = since_s
        self._own = _KnownMetric()
        self._devices = {name: _Device(name, latest, since_s=since_s) for name in settings.starters}
        self._gone: list[str] = []  # not configured any more, death not yet published
        self._dues: dict[str, float] = {}  # who has something to say, and when it goes out; empty: the node
        self._bd_seq: int | None = None  # None: no connection
        self._seq = 0
        self._rebirth_s = inf  # when the next one is due
        self._last_rebirth_s = -inf
        self.born_utc_s: float | None = None  # the first birth of this connection; None: none was published

    @property
    def is_born(self) -> bool:
        """Return whether this connection's birth was published."""
        return self._own.is_born

    @property
    def is_begun(self) -> bool:
        """Return whether it may publish on the present connection."""
        return self._bd_seq is not None

    @property
    def due_s(self) -> float:
        """Return when `take` may have something."""
        if not self.is_begun:
            return inf
        if self._gone or not self.is_born:
            return -inf
        return min([self._rebirth_s, *self._dues.values()])

    def follow(self, settings: SparkplugSettings) -> None:
        """Have other starters as devices: what is gone dies, what is new is born once it answers.

        Another set of lines needs a birth of the node.
        """
        has_same_lines = settings.lines == self._settings.lines
        self._settings = settings
        for name in self._devices.keys() - set(settings.starters):
            self._remove(name)
        for name in settings.starters:
            if name not in self._devices:
                self._add(name, self._since_s)
        if not has_same_lines:
            self._begin_births()

    def forget(self, starters: Collection[str], utc_s: float) -> None:
        """Take these as other machines: whatever they say is newer than what those before them have said."""
        for name in self._devices.keys() & set(starters):
            self._remove(name)
            self._add(name, utc_s)

    def begin(self, bd_seq: int) -> None:
        """Begin a connection: subscribed, nothing published yet."""
        self._bd_seq = bd_seq
        self._rebirth_s, self._last_rebirth_s = inf, -inf
        self._begin_births()

    def end(self) -> None:
        """End the connection: nothing is taken until the next one."""
        self._bd_seq = self.born_utc_s = None
        self._own.is_born = False

    def take_command(self, payload: bytes, now_s: float) -> None:
        """Honour a host's request for a rebirth."""
        command = decoded_command(payload)
        if command is not None and command.is_asking(REBIRTH):
            due_s = max(now_s, self._last_rebirth_s + REBIRTH_EVERY_S)
            self._rebirth_s = min(self._rebirth_s, due_s)

    def look(self, now_s: float) -> None:
        """Note which records are newer than those of the last look."""
        news = reversed(list(self._latest.newer_than(self._seen)))
        self._seen = self._latest.number
        for topic, record in news:
            branch, name = topic.split("/")[:2]
            device = self._devices.get(name) if branch == "starter" else None
            if device is not None:
                device.note(topic, record, self._settings)
                self._mark(name, device, now_s, is_urgent=device.is_urgent)
            elif isinstance(record, LineRecord):
                self._mark("", self._own, now_s)

    def note(self, facts: Mapping[str, Value], now_s: float) -> None:
        """Take what the gateway says of itself."""
        self._facts |= facts
        self._mark("", self._own, now_s)

    def answer(self, starter: str, facts: Iterable[MetricFact], now_s: float) -> None:
        """Show the outcome of a host's command, also where that is as before."""
        device = self._devices.get(starter)
        if device is not None:
            device.answer(facts)
            self._mark(starter, device, now_s)

    def take(self, *, now_s: float, utc_s: float) -> Message | None:
        """Return the next message, which must be written to the socket now; None when there is none yet."""
        if self._bd_seq is None:
            return None
        if now_s >= self._rebirth_s:
            self._last_rebirth_s, self._rebirth_s = now_s, inf
            self._begin_births()
        if not self._own.is_born:
            return self._node_birth(self._bd_seq, now_s, utc_s)
        if self._gone:
            return self._message("DDEATH", self._gone.pop(0), (), utc_s)
        for name in [name for name, due_s in self._dues.items() if now_s >= due_s]:
            del self._dues[name]
            message = self._message_of(name, now_s, utc_s)
            if message is not None:
                return message
        return None

    def death(self, bd_seq: int, utc_s: float) -> Message:
        """Return an NDEATH, the will of the connection with this number [tck-id-topics-ndeath-payload]."""
        metrics = [Metric(BD_SEQ, DataType.INT64, bd_seq, utc_s)]
        payload = encoded(metrics, time_s=utc_s, seq=None)
        return Message(self._settings.topic("NDEATH"), payload, qos=1, retain=False)

    def _node_birth(self, bd_seq: int, now_s: float, utc_s: float) -> Message:
        self._dues.pop("", None)
        self.born_utc_s = self.born_utc_s or utc_s
        self._seq = SEQ_NUMBERS - 1  # so that this one is 0
        metrics = [
            Metric(BD_SEQ, DataType.INT64, bd_seq, utc_s),
            Metric(REBIRTH, DataType.BOOLEAN, FALSE, utc_s),
            *self._own.born(self._metrics(), now_s),
        ]
        return self._message("NBIRTH", None, metrics, utc_s)

    def _message_of(self, name: str, now_s: float, utc_s: float) -> Message | None:
        """Return what is due of a device: its death, its birth, or what has changed; of the node that."""
        if not name:
            news = self._own.news(self._metrics().values(), now_s)
            return self._message("NDATA", None, news, utc_s) if news else None
        device = self._devices[name]
        if device.is_to_be_born:
            return self._message("DBIRTH", name, device.birth(now_s), utc_s)
        if device.is_born and not device.is_alive:
            device.is_born = False
            return self._message("DDEATH", name, (), utc_s)
        news = device.data(now_s) if device.is_born else []
        return self._message("DDATA", name, news, utc_s) if news else None

    def _metrics(self) -> dict[str, Metric]:
        """Return the metrics of the gateway itself: properties, its connection to the main broker, lines."""
        metrics = defined(self._facts)
        for line in self._settings.lines:
            record = self._latest.find(LineRecord.topic_of(line=line))
            data = record.data if isinstance(record, LineRecord) else {}
            for each in OF_LINES:
                name, value = f"line/{line}/{each}", data.get(each)
                quality = BAD if value is None else None
                metrics[name] = Metric(name, DataType.DOUBLE, value, quality=quality)
        return metrics

    def _message(self, kind: str, device: str | None, metrics: Collection[Metric], utc_s: float) -> Message:
        self._seq = (self._seq + 1) % SEQ_NUMBERS
        has_types = kind.endswith("BIRTH") or self._settings.table.datatypes_in_data
        payload = encoded(metrics, time_s=utc_s, seq=self._seq, has_datatypes=has_types)
        return Message(self._settings.topic(kind, device), payload, qos=0, retain=False)

    def _mark(self, name: str, known: _KnownMetric, now_s: float, *, is_urgent: bool = False) -> None:
        """Have what somebody has to say go out: a birth or death at once, all else gathered."""
        if self.is_born:  # else the births will say everything
            due_s = -inf if is_urgent else max(now_s, known.sent_s + GATHER_S)
            self._dues[name] = min(due_s, self._dues.get(name, inf))

    def _add(self, name: str, since_s: float) -> None:
        self._devices[name] = _Device(name, self._latest, since_s=since_s)
        self._seen = 0  # it may be known already

    def _remove(self, name: str) -> None:
        self._dues.pop(name, None)
        if self._devices.pop(name).is_born:
            self._gone.append(name)

    def _begin_births(self) -> None:
        for each in (self._own, *self._devices.values()):
            each.is_born = False
        self._gone.clear()
        self._dues = dict.fromkeys(self._devices, -inf)
