"""Records: what the starters and lines report upwards, from values and states to results and audit entries.

`starters` and `app` create them with a `RecordWriter`, a `RecordBus` passes them on to its subscribers;
`mqtt.contract.payloads` converts each to a topic and a payload. Times are seconds since 1970, UTC. `seq`
identifies and orders the records of one run (boot): `SequenceNumbers` counts them up by one.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Protocol, get_args

from gateway.system.clock import Clock

SELECT, CANCEL, LOCK, UNLOCK, ACCEPT = "select", "cancel", "lock", "unlock", "accept"
BASELINE = "baseline"  # later starts are compared with this one
READ = "read"  # it writes nothing
STOP = "stop"  # judged, written and stored before everything else, or without it
OWN_VERBS = (
    SELECT,
    CANCEL,
    LOCK,
    UNLOCK,
    ACCEPT,
    BASELINE,
)  # of every family: they concern the gateway alone


class Quality(enum.StrEnum):
    """How far a value can be trusted."""

    GOOD = "good"  # just read
    STALE = "stale"  # the last good value, with its own old time
    BAD = "bad"  # never read, refused, impossible, or of a device that contradicts the configuration


class Severity(enum.StrEnum):
    """How much an event matters; `ERROR` means that a person must act."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Phase(enum.StrEnum):
    """Where a command is; the last four are final, and exactly one of them ends every command."""

    ACCEPTED = "accepted"
    WRITTEN = "written"
    CONFIRMED = "confirmed"
    REJECTED = "rejected"
    FAILED = "failed"
    UNCONFIRMED = "unconfirmed"

    @property
    def is_final(self) -> bool:
        """Return whether nothing follows this phase."""
        return self not in (Phase.ACCEPTED, Phase.WRITTEN)


def rfc3339(time_s: float | None) -> str | None:
    """Return seconds since 1970 as `2026-11-21T01:02:03.456Z`; None when unknown or beyond the calendar."""
    if time_s is None or not math.isfinite(time_s):
        return None
    try:
        moment = datetime.fromtimestamp(round(time_s, 3), UTC)
    except (ValueError, OverflowError, OSError):
        return None
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"


@dataclass(frozen=True, slots=True)
class ValueRecord:
    """One point's value; `time_s` is None when it was never read."""

    starter: str
    point: str
    value: bool | int | float | str | None
    unit: str
    quality: Quality
    time_s: float | None
    seq: int
    label: str | None = None  # of an enum
    reason: str = ""  # why it is bad, where the starter as a whole is the cause


@dataclass(frozen=True, slots=True)
class LockRecord:
    """A maintenance lock: by whom, since when and why. It replaces no physical lock."""

    by: str  # the client
    since_s: float
    reason: str
    operator: str | None = None  # a claim


@dataclass(frozen=True, slots=True)
class StateRecord:
    """The state of a starter, with its boolean points beside it."""

    starter: str
    state: str
    quality: Quality
    time_s: float | None
    seq: int
    flags: Mapping[str, bool | None] = field(default_factory=dict)
    lock: LockRecord | None = None
    reason: str = ""  # why it is unknown although the starter answers
    fault_code: int | None = None  # number of the present fault, where the starter gives one


@dataclass(frozen=True, slots=True)
class AvailabilityRecord:
    """Whether a starter answers: online, offline or disabled."""

    starter: str
    state: str
    since_s: float
    reason: str | None


@dataclass(frozen=True, slots=True)
class AlarmRecord:
    """A fault or alarm that is active or has been cleared."""

    starter: str
    code: str
    is_active: bool
    severity: str
    text: str
    time_s: float
    cleared_s: float | None
    count: int
    seq: int


@dataclass(frozen=True, slots=True)
class InfoRecord:
    """What a starter is: everything but its values."""

    starter: str
    family: str
    model: str | None
    firmware: str | None
    serial: str | None
    line: str
    address: int
    points: Mapping[str, Mapping[str, Any]]  # name -> unit, type, enum, deadband
    commands: tuple[str, ...]
    hardware: str | None = None  # version
    rated_current_a: float | None = None
    rating: str | None = None  # SSW900: the currents of its size
    slot: int | None = None  # SSW900: of the RS-485 accessory
    accessories: tuple[str, ...] = ()  # SSW900: the kinds in slots 1 and 2


@dataclass(frozen=True, slots=True)
class EventRecord:
    """Something that happened once; `starter` is empty for the gateway's own events."""

    starter: str
    code: str
    severity: Severity
    text: str
    time_s: float
    seq: int
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ResultRecord:
    """One phase of a command's life."""

    starter: str
    client: str
    id: str | None
    verb: str
    phase: Phase
    code: str
    text: str
    time_s: float
    is_duplicate: bool = False
    values: Mapping[str, Any] = field(default_factory=dict)  # value, unit, label, raw, parameter
    correlation: bytes | None = None  # MQTT 5 correlation data, echoed
    response_topic: str | None = None  # MQTT 5 response topic, already checked

    @property
    def key(self) -> str:
        """Return what names a command's one final result; empty for every other phase and for repetitions."""
        is_sole = self.phase.is_final and not self.is_duplicate
        return f"{self.client}/{self.id}" if is_sole and self.id else ""


@dataclass(frozen=True, slots=True)
class AuditRecord:
    """One decision about a command."""

    starter: str
    client: str
    operator: str | None  # a claim
    verb: str
    args: Mapping[str, Any]
    decision: str
    code: str
    time_s: float
    seq: int
    before: Mapping[str, Any] = field(default_factory=dict)
    after: Mapping[str, Any] = field(default_factory=dict)
    id: str | None = None
    reason: str | None = None  # the operator's, a claim
    source: str = ""  # "web": the status page; empty: MQTT

    def as_data(self) -> dict[str, Any]:
        """Return what MQTT and the audit files say alike; what the operator claims is named by each."""
        data = {
            "seq": self.seq,
            "time": rfc3339(self.time_s),
            "starter": self.starter,
            "client": self.client,
            "verb": self.verb,
            "args": self.args,
            "decision": self.decision,
            "code": self.code,
            "before": self.before,
            "after": self.after,
            "id": self.id,
        }
        return {**data, "source": self.source} if self.source else data


@dataclass(frozen=True, slots=True)
class StartRecord:
    """One start of a motor with its samples, once it is over."""

    starter: str
    id: str
    data: Mapping[str, Any]  # `history.start_record`

    @property
    def key(self) -> str:
        """Return what names it until the broker has it; no client's name has a colon in it."""
        return f"{self.starter}:start/{self.id}"


@dataclass(frozen=True, slots=True)
class TripRecord:
    """One trip with what was read before it."""

    starter: str
    id: str
    data: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Return what names it until the broker has it; no client's name has a colon in it."""
        return f"{self.starter}:trip/{self.id}"


@dataclass(frozen=True, slots=True)
class LineRecord:
    """The statistics of a line; published every 30 s and on change."""

    line: str
    statistics: Mapping[str, Any]


Record = (
    ValueRecord
    | StateRecord
    | AvailabilityRecord
    | AlarmRecord
    | InfoRecord
    | EventRecord
    | ResultRecord
    | AuditRecord
    | StartRecord
    | TripRecord
    | LineRecord
)
KINDS: tuple[type[Record], ...] = get_args(Record)


class Sink(Protocol):
    """Where records go; must return at once and never raise."""

    def put(self, record: Record) -> None:
        """Take one record, in order."""


class PublishEvent(Protocol):
    """Publishes an event of the gateway's own; must return at once and never raise."""

    def __call__(
        self, code: str, severity: Severity, text: str, data: Mapping[str, Any] | None = None, /
    ) -> None:
        """Take its code, severity, text for people, and data for programs."""


class SequenceNumbers:
    """Counts up by one from 1; the gateway has exactly one, used on the application's loop only."""

    def __init__(self) -> None:
        self._last = 0

    def take(self) -> int:
        """Return the next number."""
        self._last += 1
        return self._last


@dataclass(frozen=True, slots=True)
class RecordWriter:
    """Where records go, the clock that dates them and the numbers that order them."""

    sink: Sink
    clock: Clock
    sequence: SequenceNumbers = field(default_factory=SequenceNumbers)

    def put(self, record: Record) -> None:
        """Publish a record."""
        self.sink.put(record)

    def event(
        self, starter: str, code: str, severity: Severity, text: str, data: Mapping[str, Any] | None = None
    ) -> None:
        """Publish something that happens now, to a starter or (with an empty name) to the gateway."""
        self.sink.put(
            EventRecord(starter, code, severity, text, self.clock.utc_s(), self.sequence.take(), data or {})
        )


class RecordBus:
    """A sink for everyone who makes records; on the app's loop. Never raises.

    1. A subscriber gets the kinds that it names in `takes`; one that names none gets every record.
    2. The order is the subscribers' order in `connect`; whatever was put before goes to them first.
    3. A subscriber that fails loses that record alone: `on_failure` is called with it while its exception is
       handled, and the others get the record all the same.
    4. A record that a subscriber puts while it handles another one reaches all of them before that other goes
       on.
    """

    def __init__(self, on_failure: Callable[[Sink], None]) -> None:
        self._on_failure = on_failure
        self._subscribers: tuple[Sink, ...] = ()
        self._takers: dict[type[Record], tuple[Sink, ...]] = {}
        self._early: list[Record] = []  # put while the gateway was being built

    def connect(self, *subscribers: Sink) -> None:
        """Pass records on to these, in this order, from the first on; once."""
        self._subscribers = subscribers
        self._takers = {
            kind: tuple(each for each in subscribers if kind in getattr(each, "takes", KINDS))
            for kind in KINDS
        }
        early, self._early = self._early, []
        for record in early:
            self.put(record)

    def put(self, record: Record) -> None:
        """Pass one record on."""
        if not self._subscribers:
            self._early.append(record)
            return
        for subscriber in self._takers[type(record)]:
            try:
                subscriber.put(record)
            except Exception:  # noqa: BLE001 - one subscriber's bug is not the others'; it is logged
                self._on_failure(subscriber)
