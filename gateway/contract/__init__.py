"""What the gateway says and takes, as types: records, requests, topics, and JSON both ways. Pure.

A record is its payload; `docs/reference` and asyncapi.yaml are generated from here.
"""

from gateway.contract.bus import Latest, PublishEvent, RecordWriter, Sink
from gateway.contract.events import Event, EventCode, event_of, phrase
from gateway.contract.json_text import encoded, read_object
from gateway.contract.records import (
    AlarmRecord,
    AuditRecord,
    AvailabilityRecord,
    Cause,
    EventRecord,
    ForgetRecord,
    FreshRecord,
    GatewayRecord,
    HistoryRecord,
    InfoRecord,
    LineRecord,
    LockRecord,
    Operator,
    OutboxRecord,
    Presence,
    QuantityChange,
    ReadingTable,
    Record,
    ResultRecord,
    StartOutcome,
    StartRecord,
    StateRecord,
    StatusRecord,
    TripRecord,
    ValueRecord,
    history_item,
    read_record,
    read_stored,
    stored,
)
from gateway.contract.request import (
    DEFAULT_TTL_S,
    MAX_PAYLOAD_BYTES,
    MAX_TTL_S,
    CommandBody,
    CommandRequest,
    read_body,
)
from gateway.contract.results import (
    CommandError,
    Note,
    Reason,
    ResultCode,
    joined,
    meaning_of,
)
from gateway.contract.topics import (
    CommandAddress,
    Topics,
    is_level,
    shortened,
    to_level,
)
from gateway.contract.values import StartSamples
from gateway.contract.vocabulary import (
    ACCEPT,
    BASELINE,
    CANCEL,
    CONTRACT_VERSION,
    LOCK,
    OWN_VERBS,
    READ,
    SELECT,
    STOP,
    UNLOCK,
    GatewayState,
    Phase,
    Quality,
    Severity,
    StarterState,
    rfc3339,
)
