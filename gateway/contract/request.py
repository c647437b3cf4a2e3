"""A command as it came in: not yet judged by its starter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

WITHOUT_TTL_S = 10.0  # so long a command without a time of its own may wait to be written


@dataclass(frozen=True, slots=True)
class CommandRequest:
    """One operator's wish."""

    starter: str
    client: str  # the level in the command topic, tied to a login by the broker
    verb: str
    id: str | None = None  # None only for a stop
    args: Mapping[str, Any] = field(default_factory=dict)
    operator: str | None = None  # a claim
    reason: str | None = None
    received_s: float = 0.0  # on the steady clock
    correlation: bytes | None = None  # MQTT 5 correlation data, to be echoed
    response_topic: str | None = None  # MQTT 5 response topic, already checked
    expect: Mapping[str, Any] = field(default_factory=dict)  # what must still be so: state, or points
    select: str | None = None  # the token of a selection
    expires_s: float | None = None  # on the steady clock: not to be written later than this
    decided_s: float | None = None  # on the steady clock: not decided upon before; None: that is not known
    decided_by: str = ""  # what shows that: token or issued_at
    source: str = ""  # "web": the status page; empty: MQTT
    remark: str = ""  # on how it was sent; each of its results says so

    @property
    def until_s(self) -> float:
        """Return when its time to be written is over, on the steady clock."""
        return self.received_s + WITHOUT_TTL_S if self.expires_s is None else self.expires_s
