"""A command as it came in, whichever way: what is asked, by whom, and what proves it fresh."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    WithJsonSchema,
)

from gateway.contract.json_text import read_object
from gateway.contract.records import ResultRecord
from gateway.contract.results import CommandError, ResultCode
from gateway.contract.topics import shortened
from gateway.system.value_demands import demand_of

DEFAULT_TTL_S, MAX_TTL_S = 5.0, 60.0  # so long a token is remembered
WITHOUT_TTL_S = 10.0  # so long a command without a time of its own may wait to be written
MAX_PAYLOAD_BYTES = 4096

_INSTANT = re.compile(  # RFC 3339 5.6
    r"\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d(\.\d{1,9})?([Zz]|[+-]\d\d:\d\d)", re.ASCII
)

_OF_ANY = ("id", "operator", "reason", "args")  # what is understood of a payload that is wrong elsewhere


@dataclass(frozen=True, slots=True)
class Proof:
    """The part of a command that shows when it was decided upon; `issued_s` is UTC, seconds since 1970."""

    token: str | None = None
    issued_s: float | None = None
    boot: str | None = None
    ttl_s: float = DEFAULT_TTL_S
    is_early: bool = False  # it came before the connection was reported


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
    expect: Mapping[str, Any] = field(default_factory=dict)  # what must still be so: state, or points
    select: str | None = None  # the token of a selection
    proof: Proof = Proof()
    expires_s: float | None = None  # on the steady clock: not to be written later than this
    decided_s: float | None = None  # on the steady clock: not decided upon before; None: that is not known
    source: str = ""  # "web": the status page; empty: MQTT
    remark: str = ""  # on how it was sent; each of its results says so
    follow: Callable[[ResultRecord], None] | None = field(default=None, compare=False)  # gets its results

    @property
    def until_s(self) -> float:
        """Return when its time to be written is over, on the steady clock."""
        return self.received_s + WITHOUT_TTL_S if self.expires_s is None else self.expires_s


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("must have printable characters only")
    return text


def _instant(text: object) -> float:
    """Return the seconds since 1970, UTC."""
    if not isinstance(text, str) or _INSTANT.fullmatch(text) is None:
        raise ValueError("must be an RFC 3339 time with an offset, such as 2026-11-21T01:02:03Z")
    return datetime.fromisoformat(text.upper()).timestamp()


_Id = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_printable)]
_Instant = Annotated[float, BeforeValidator(_instant), WithJsonSchema({"type": "string"})]
_Expected = bool | int | float | Annotated[str, Field(max_length=64)]
_Reason = Annotated[str, Field(max_length=256), AfterValidator(_printable)]


class CommandBody(BaseModel):
    """The payload of a command; nothing unknown, nothing converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, hide_input_in_errors=True)

    id: _Id | None = Field(None, description="names this one decision; every verb but stop needs it")
    token: _Id | None = Field(None, description="of gateway/fresh: the proof of freshness")
    issued_at: _Instant | None = Field(
        None, description="RFC 3339 time with offset: the proof on a synchronised clock"
    )
    ttl_s: float = Field(DEFAULT_TTL_S, gt=0, le=MAX_TTL_S, description="how old the proof may be, s")
    boot: _Id | None = Field(None, description="of gateway/status: another than the present one is refused")
    operator: _Id | None = Field(None, description="who decides, a claim; for the audit")
    reason: _Reason | None = Field(None, description="why, for the audit")
    args: dict[str, Any] = Field(default_factory=dict, description="what the verb needs")
    expect: dict[_Id, _Expected] = Field(
        default_factory=dict, max_length=16, description="points and the values that they must have"
    )
    select: _Id | None = Field(None, description="token of a `select` before")

    @property
    def proof(self) -> Proof:
        """Return what shows when it was decided upon."""
        return Proof(token=self.token, issued_s=self.issued_at, boot=self.boot, ttl_s=self.ttl_s)


def read_body(payload: bytes) -> tuple[CommandBody, CommandError | None]:
    """Return the payload of a command, and what is wrong with it, which must be right in every detail.

    Of a wrong one that is returned which can be understood: enough for a stop, and to name a refused command.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        most = MAX_PAYLOAD_BYTES
        return CommandBody(), CommandError(ResultCode.TOO_BIG, "payload", size=len(payload), most=most)
    try:
        fields = read_object(payload)
    except ValueError as error:
        return CommandBody(), CommandError(ResultCode.BAD_JSON, why=shortened(str(error), 200))
    try:
        body = CommandBody.model_validate(fields)
    except ValidationError as error:
        wrong = {mistake["loc"][0] for mistake in error.errors()}
        body = CommandBody(**{name: fields[name] for name in _OF_ANY if name in fields and name not in wrong})
        mistakes = shortened(_explained(error), 200)
        return body, CommandError(ResultCode.BAD_PAYLOAD, "fields", mistakes=mistakes)
    return body, CommandError(ResultCode.NO_ID) if body.id is None else None


def _explained(error: ValidationError) -> str:
    return "; ".join(
        f"{'.'.join(map(str, mistake['loc']))} {demand_of(mistake)}"
        for mistake in error.errors(include_url=False, include_input=False)
    )
