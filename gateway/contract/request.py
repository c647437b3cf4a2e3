"""A command as it came in, whichever way: what is asked, by whom, and what proves it fresh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    StrictFloat,
    StrictInt,
    ValidationError,
    WithJsonSchema,
)

from gateway.contract.json_text import adapter_of, read_object
from gateway.contract.records import ResultRecord
from gateway.contract.results import CommandError, ResultCode
from gateway.contract.topics import shortened
from gateway.contract.values import says
from gateway.contract.vocabulary import STOP, seconds_of
from gateway.system.value_demands import demand_of

DEFAULT_TTL_S, MAX_TTL_S = 5.0, 60.0  # so long a token is remembered
WITHOUT_TTL_S = 10.0  # so long a command without a time of its own may wait to be written
MAX_PAYLOAD_BYTES = 4096

_OF_STOP = ("id", "operator", "reason")
_OF_ANY = (*_OF_STOP, "args")  # what is understood of a payload that is wrong elsewhere


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("must have printable characters only")
    return text


_Id = Annotated[str, Field(min_length=1, max_length=64, strict=True), AfterValidator(_printable)]
_Instant = Annotated[float, BeforeValidator(seconds_of), WithJsonSchema({"type": "string"})]  # since 1970
_Expected = StrictBool | StrictInt | StrictFloat | Annotated[str, Field(max_length=64, strict=True)]
_Reason = Annotated[str, Field(max_length=256, strict=True), AfterValidator(_printable)]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandBody:
    """The payload of a command; nothing unknown, nothing converted."""

    __pydantic_config__ = ConfigDict(extra="forbid", hide_input_in_errors=True)

    id: Annotated[_Id | None, says("names this one decision; every verb but stop needs it")] = None
    token: Annotated[_Id | None, says("of gateway/fresh: the proof of freshness")] = None
    issued_s: Annotated[
        _Instant | None,
        says("RFC 3339 time with offset: the proof on a synchronised clock", alias="issued_at"),
    ] = None
    ttl_s: Annotated[float, says("how old the proof may be, s", gt=0, le=MAX_TTL_S, strict=True)] = (
        DEFAULT_TTL_S
    )
    boot: Annotated[_Id | None, says("of gateway/status: another than the present one is refused")] = None
    operator: Annotated[_Id | None, says("who decides, a claim; for the audit")] = None
    reason: Annotated[_Reason | None, says("why, for the audit")] = None
    args: Annotated[Mapping[str, Any], says("what the verb needs")] = field(default_factory=dict)
    expect: Annotated[
        Mapping[_Id, _Expected], says("points and the values that they must have", max_length=16)
    ] = field(default_factory=dict)
    select: Annotated[_Id | None, says("token of a `select` before")] = None

    def as_request(self, starter: str, client: str, verb: str, **besides: Any) -> CommandRequest:
        """Return the command that has this payload; `besides` are further fields of it.

        A stop keeps only its id, operator and reason: nothing else in a payload may hold it up.
        """
        said = {name: getattr(self, name) for name in (_OF_STOP if verb == STOP else CommandBody.__slots__)}
        return CommandRequest(starter, client, verb, **{**said, **besides})


_BODY = adapter_of(CommandBody)  # built here: the first stop of a run must not wait for it


@dataclass(frozen=True, slots=True)
class CommandRequest(CommandBody):
    """One operator's wish."""

    starter: str
    client: str  # the level in the command topic, tied to a login by the broker
    verb: str
    _: KW_ONLY
    received_s: float = 0.0  # on the steady clock
    is_early: bool = False  # it came before the connection was reported
    correlation: bytes | None = None  # MQTT 5 correlation data, to be echoed
    expires_s: float | None = None  # on the steady clock: not to be written later than this
    decided_s: float | None = None  # on the steady clock: not decided upon before; None: that is not known
    source: str = ""  # "web": the status page; empty: MQTT
    remark: str = ""  # on how it was sent; each of its results says so
    follow: Callable[[ResultRecord], None] | None = field(default=None, compare=False)  # gets its results

    @property
    def until_s(self) -> float:
        """Return when its time to be written is over, on the steady clock."""
        return self.received_s + WITHOUT_TTL_S if self.expires_s is None else self.expires_s


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
        body: CommandBody = _BODY.validate_python(fields)
    except ValidationError as error:
        mistakes = error.errors(include_url=False, include_input=False)
        right = fields.keys() - {each["loc"][0] for each in mistakes}
        body = CommandBody(**{name: fields[name] for name in _OF_ANY if name in right})
        text = "; ".join(f"{'.'.join(map(str, each['loc']))} {demand_of(each)}" for each in mistakes)
        return body, CommandError(ResultCode.BAD_PAYLOAD, "fields", mistakes=shortened(text, 200))
    return body, CommandError(ResultCode.NO_ID) if body.id is None else None
