"""Reads a message on a command topic: form and retained flag, but neither its freshness nor its starter."""

from __future__ import annotations

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
    Topics,
    read_body,
    read_leniently,
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
class Rejection:
    """A command that is not carried out: as far as it is legible, and which rule refuses it."""

    request: CommandRequest
    error: CommandError
    problem: str = ""  # of a malformed topic, in a word


def command_in(topics: Topics, incoming: Incoming, received_s: float) -> CommandRequest | Rejection | None:
    """Return the well-formed command of a message, or why it is none; None on any other topic.

    `received_s` is when it arrived, on the steady clock.
    """
    address = topics.parse_command(incoming.topic)
    if address is None:
        return None
    lenient = read_leniently(incoming.payload)
    if isinstance(address, Malformed):
        request = _request(address, incoming, body=lenient, received_s=received_s)
        error = CommandError(ResultCode.MALFORMED_TOPIC, why=address.text)
        return Rejection(request, error, problem=address.problem)
    try:
        if incoming.is_retained and not (address.verb == STOP and incoming.is_live):
            raise CommandError(ResultCode.RETAINED)  # noqa: TRY301 - as for the others
        if address.verb == STOP:
            request = _request(address, incoming, body=lenient, received_s=received_s)
            remark = RETAINED_STOP.text if incoming.is_retained else ""
            return replace(request, args={}, remark=remark)  # nothing in a payload may hold up a stop
        body = read_body(incoming.payload)
        if incoming.expiry_s == 0:
            raise CommandError(ResultCode.EXPIRED, "message")  # noqa: TRY301 - as for the others
    except CommandError as error:
        request = _request(address, incoming, body=lenient, received_s=received_s)
        return Rejection(request, error)
    request = _request(address, incoming, body=body, received_s=received_s)
    expires_s = None if incoming.expiry_s is None else received_s + incoming.expiry_s
    return replace(request, expires_s=expires_s)


def _request(
    address: CommandAddress | Malformed,
    incoming: Incoming,
    *,
    body: CommandBody,
    received_s: float,
) -> CommandRequest:
    return CommandRequest(
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
    )
