"""Checks a message on a command topic: form, retained flag and age, but nothing of the starter."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from gateway.contract import (
    STOP,
    CommandAddress,
    CommandError,
    CommandRequest,
    Malformed,
    Note,
    ResultCode,
    ResultRecord,
    Topics,
    read_object,
    shortened,
)
from gateway.starters.policy.freshness import (
    BY_TOKEN,
    DEFAULT_TTL_S,
    MAX_TTL_S,
    Decision,
    Moment,
    Proof,
    Tokens,
    before_connection,
    decision_of,
)
from gateway.system.value_demands import demand_of

MAX_PAYLOAD_BYTES = 4096
RETAINED_STOP = Note("retained_stop")

_INSTANT = re.compile(  # RFC 3339 5.6
    r"\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d(\.\d{1,9})?([Zz]|[+-]\d\d:\d\d)", re.ASCII
)


@dataclass(frozen=True, slots=True)
class Incoming:
    """A message as the broker delivered it, or as the status page took it.

    `expiry_s`, `response_topic` and `correlation` come with MQTT 5 only. `is_live` says of a retained one
    that it was published just now and not stored before, which MQTT 5 alone shows. `is_early` says that it
    came before the connection was reported. `source` names another way than the broker; `operator` is then
    who logged in there, whatever the payload claims.
    """

    topic: str
    payload: bytes
    is_retained: bool = False
    is_live: bool = False
    is_early: bool = False
    expiry_s: int | None = None
    response_topic: str | None = None
    correlation: bytes | None = None
    source: str = ""
    operator: str | None = None


@dataclass(frozen=True, slots=True)
class Rejection:
    """A command that is not carried out: as far as it is legible, and which rule refuses it."""

    request: CommandRequest
    error: CommandError
    problem: str = ""  # of a malformed topic, in a word


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("must have printable characters only")
    return text


def _instant(text: str) -> str:
    _utc_s(text)
    return text


_Id = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_printable)]
_Instant = Annotated[str, Field(max_length=40), AfterValidator(_instant)]
_Expected = bool | int | float | Annotated[str, Field(max_length=64)]
_Reason = Annotated[str, Field(max_length=256), AfterValidator(_printable)]


class _Body(BaseModel):
    """The payload of a command; nothing unknown, nothing converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, hide_input_in_errors=True)

    id: _Id | None = None
    token: _Id | None = None
    issued_at: _Instant | None = None
    ttl_s: float = Field(default=DEFAULT_TTL_S, gt=0, le=MAX_TTL_S)
    boot: _Id | None = None
    operator: _Id | None = None
    reason: _Reason | None = None
    args: dict[str, Any] = Field(default_factory=dict)
    expect: dict[_Id, _Expected] = Field(default_factory=dict, max_length=16)
    select: _Id | None = None


_ID = TypeAdapter(_Id, config=ConfigDict(strict=True))
_REASON = TypeAdapter(_Reason, config=ConfigDict(strict=True))


def _by_token(_: CommandAddress) -> Collection[str]:
    return (BY_TOKEN,)


@dataclass(frozen=True, slots=True)
class CommandParser:
    """Judges incoming messages for one base and one run of the gateway.

    `freshness_of` returns the settings that say what may prove an operator's command fresh.
    """

    topics: Topics
    tokens: Tokens
    freshness_of: Callable[[CommandAddress], Collection[str]] = _by_token

    def judge(
        self, incoming: Incoming, moment: Moment, *, received_s: float | None = None
    ) -> CommandRequest | Rejection | None:
        """Return a well-formed, fresh command, or why it is refused; None when it is no command at all.

        `received_s` is when it arrived, on the steady clock: `moment` unless it has waited to be parsed.
        """
        received_s = moment.now_s if received_s is None else received_s
        address = self.topics.parse_command(incoming.topic)
        if address is None:
            return None
        lenient = _read_leniently(incoming.payload)
        if isinstance(address, Malformed):
            error = CommandError(ResultCode.MALFORMED_TOPIC, why=address.text)
            return _rejected(address, lenient, incoming, error)
        try:
            if incoming.is_retained and not (address.verb == STOP and incoming.is_live):
                raise CommandError(ResultCode.RETAINED)  # noqa: TRY301 - as for the others
            if address.verb == STOP:
                return self._request(address, incoming, body=lenient, received_s=received_s)
            body, decision = self._proven(address, incoming, moment)
        except CommandError as error:
            return _rejected(address, lenient, incoming, error)
        request = self._request(address, incoming, body=body, received_s=received_s)
        expires_s = decision.since_s + body.ttl_s
        if incoming.expiry_s is not None:
            expires_s = min(expires_s, received_s + incoming.expiry_s)
        return replace(request, expires_s=expires_s, decided_s=decision.earliest_s, decided_by=decision.proof)

    def _proven(self, address: CommandAddress, incoming: Incoming, moment: Moment) -> tuple[_Body, Decision]:
        """Return the body of a command to act on, and when it was decided upon; CommandError for others."""
        body = _read_strictly(incoming.payload)
        if incoming.expiry_s == 0:
            raise CommandError(ResultCode.EXPIRED, "message")
        decision = decision_of(
            _proof(body),
            verb=address.verb,
            freshness=self._proofs_of(address, incoming),
            tokens=self.tokens,
            moment=moment,
        )
        if incoming.is_early:
            raise before_connection()
        return body, decision

    def _request(
        self, address: CommandAddress, incoming: Incoming, *, body: _Body, received_s: float
    ) -> CommandRequest:
        # Results go to one topic only, so that the broker's ACL decides who reads them.
        is_ours = incoming.response_topic == self.topics.of(
            ResultRecord, starter=address.starter, client=address.client
        )
        return CommandRequest(
            starter=address.starter,
            client=address.client,
            verb=address.verb,
            id=body.id,
            args=body.args if address.verb != STOP else {},  # nothing in a payload may hold up a stop
            operator=incoming.operator or body.operator,
            reason=body.reason,
            received_s=received_s,
            correlation=incoming.correlation,
            response_topic=incoming.response_topic if is_ours else None,
            expect=body.expect,
            select=body.select,
            source=incoming.source,
            remark=RETAINED_STOP.text if incoming.is_retained else "",
        )

    def _proofs_of(self, address: CommandAddress, incoming: Incoming) -> Collection[str]:
        """Return what may prove a command fresh: no bridge lies between this gateway and its own page."""
        return (BY_TOKEN,) if incoming.source else self.freshness_of(address)


def _proof(body: _Body) -> Proof:
    issued_s = None if body.issued_at is None else _utc_s(body.issued_at)
    return Proof(token=body.token, issued_s=issued_s, boot=body.boot, ttl_s=body.ttl_s)


def _rejected(
    address: CommandAddress | Malformed, lenient: _Body, incoming: Incoming, error: CommandError
) -> Rejection:
    request = CommandRequest(
        starter=address.starter,
        client=address.client,
        verb=address.verb,
        id=lenient.id,
        args=lenient.args,
        operator=incoming.operator or lenient.operator,
        correlation=incoming.correlation,
        source=incoming.source,
    )
    problem = address.problem if isinstance(address, Malformed) else ""
    return Rejection(request, error, problem=problem)


def _read_strictly(payload: bytes) -> _Body:
    """Return the payload of a command that must be right in every detail."""
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise CommandError(ResultCode.TOO_BIG, "payload", size=len(payload), most=MAX_PAYLOAD_BYTES)
    try:
        fields = read_object(payload)
    except ValueError as error:
        raise CommandError(ResultCode.BAD_JSON, why=shortened(str(error), 200)) from error
    try:
        body = _Body.model_validate(fields)
    except ValidationError as error:
        raise CommandError(
            ResultCode.BAD_PAYLOAD, "fields", mistakes=shortened(_explained(error), 200)
        ) from error
    if body.id is None:
        raise CommandError(ResultCode.NO_ID)
    return body


def _read_leniently(payload: bytes) -> _Body:
    """Return what can be understood of a payload: enough for a stop, and to name a refused command."""
    if len(payload) > MAX_PAYLOAD_BYTES:
        return _Body()
    try:
        fields = read_object(payload)
    except ValueError:
        return _Body()
    args = fields.get("args")
    return _Body(
        id=_valid(_ID, fields.get("id")),
        operator=_valid(_ID, fields.get("operator")),
        reason=_valid(_REASON, fields.get("reason")),
        args=args if isinstance(args, dict) else {},
    )


def _valid(adapter: TypeAdapter[str], value: object) -> str | None:
    try:
        return adapter.validate_python(value)
    except ValidationError:
        return None


def _explained(error: ValidationError) -> str:
    return "; ".join(
        f"{'.'.join(map(str, mistake['loc']))} {demand_of(mistake['type'], mistake.get('ctx', {}))}"
        for mistake in error.errors(include_url=False, include_input=False)
    )


def _utc_s(text: str) -> float:
    if _INSTANT.fullmatch(text) is None:
        raise ValueError("must be an RFC 3339 time with an offset, such as 2026-11-21T01:02:03Z")
    return datetime.fromisoformat(text.upper()).timestamp()
