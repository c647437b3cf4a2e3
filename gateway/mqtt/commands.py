"""Reads a message on a command topic: form and retained flag, but neither its freshness nor its starter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gateway.contract import (
    STOP,
    CommandAddress,
    CommandBody,
    CommandError,
    CommandRequest,
    Malformed,
    Note,
    ResultCode,
    read_body,
)

RETAINED_STOP = Note("retained_stop")


@dataclass(frozen=True, slots=True)
class Incoming:
    """A message as the broker delivered it.

    Its response topic counts for nothing: results go to one topic, so that the broker's ACL decides who reads
    them. `expiry_s` and `correlation` come with MQTT 5 only. `is_live` says of a retained one that it was
    published just now and not stored before, which MQTT 5 alone shows. `is_early` says that it came before
    the connection was reported.
    """

    topic: str
    payload: bytes
    is_retained: bool = False
    is_live: bool = False
    is_early: bool = False
    expiry_s: int | None = None
    correlation: bytes | None = None


@dataclass(frozen=True, slots=True)
class Received:
    """A command as far as it is legible, and which rule refuses it, where one does."""

    request: CommandRequest
    refusal: CommandError | None = None
    problem: str = ""  # of a topic that names no command, in a word


def command_in(
    address: CommandAddress | Malformed,
    incoming: Incoming,
    received_s: float,
    *,
    verb_error: Callable[[str, str], CommandError | None],
) -> Received:
    """Return the command of a message whose topic says `address`.

    `received_s` is when it arrived, on the steady clock; `verb_error` says what is wrong with a verb for a
    starter.
    """
    body, mistake = read_body(incoming.payload)
    is_stop, expires_s = address.verb == STOP, None
    if is_stop:  # nothing else in a payload may hold up a stop
        body = CommandBody(id=body.id, operator=body.operator, reason=body.reason)
    elif incoming.expiry_s is not None:
        expires_s = received_s + incoming.expiry_s
    request = CommandRequest(
        starter=address.starter,
        client=address.client,
        verb=address.verb,
        id=body.id,
        args=body.args,
        operator=body.operator,
        reason=body.reason,
        received_s=received_s,
        correlation=incoming.correlation,
        expect=body.expect,
        select=body.select,
        proof=replace(body.proof, is_early=incoming.is_early),
        expires_s=expires_s,
    )
    # The order of the refusals: first what the topic says, which alone needs no payload.
    if isinstance(address, Malformed):
        error = CommandError(ResultCode.MALFORMED_TOPIC, why=address.text)
        return Received(request, error, problem=address.problem)
    unknown = verb_error(address.starter, address.verb)
    if unknown is not None:
        return Received(request, unknown, problem=unknown.code)
    if incoming.is_retained and not (is_stop and incoming.is_live):
        return Received(request, CommandError(ResultCode.RETAINED))
    if is_stop:
        return Received(replace(request, remark=RETAINED_STOP.text if incoming.is_retained else ""))
    if mistake is None and incoming.expiry_s == 0:
        mistake = CommandError(ResultCode.EXPIRED, "message")
    return Received(request, mistake)
