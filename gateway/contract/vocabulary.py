"""The words that records and requests share: qualities, severities, phases, verbs, and times as text."""

from __future__ import annotations

import enum
import math
import re
from datetime import UTC, datetime
from functools import lru_cache
from typing import Literal

CONTRACT_VERSION = 1

SELECT, CANCEL, LOCK, UNLOCK, ACCEPT = "select", "cancel", "lock", "unlock", "accept"
BASELINE = "baseline"  # later starts are compared with this one
READ = "read"  # it writes nothing
STOP = "stop"  # judged, written and stored before everything else, or without it
OWN_VERBS = (SELECT, CANCEL, LOCK, UNLOCK, ACCEPT, BASELINE)  # of every family: they concern the gateway


_INSTANT = re.compile(  # RFC 3339 5.6
    r"\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d(\.\d{1,9})?([Zz]|[+-]\d\d:\d\d)", re.ASCII
)

StarterState = Literal["ready", "starting", "running", "stopping", "fault", "not_ready", "unknown"]
GatewayState = Literal["starting", "online", "degraded", "offline"]


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


@lru_cache(maxsize=64)  # the points of one reply have one time
def rfc3339(time_s: float | None) -> str | None:
    """Return seconds since 1970 as `2026-11-21T01:02:03.456Z`; None when unknown or beyond the calendar."""
    if time_s is None or not math.isfinite(time_s):
        return None
    try:
        moment = datetime.fromtimestamp(round(time_s, 3), UTC)
    except (ValueError, OverflowError, OSError):
        return None
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"


def seconds_of(text: object) -> float:
    """Return the seconds since 1970, UTC, of an RFC 3339 time with an offset; else ValueError."""
    if not isinstance(text, str) or _INSTANT.fullmatch(text) is None:
        raise ValueError("must be an RFC 3339 time with an offset, such as 2026-11-21T01:02:03Z")
    return datetime.fromisoformat(text.upper()).timestamp()
