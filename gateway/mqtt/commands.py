"""Commands as MQTT brings them: a message is read by its form and retained flag, then submitted or answered.

Its freshness and its starter are judged elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gateway.contract import (
    STOP,
    CommandAddress,
    CommandBody,
    CommandError,
    CommandRequest,
    EventCode,
    Note,
    PublishEvent,
    ResultCode,
    read_body,
    shortened,
)
from gateway.starters import Commands
from gateway.system.clock import Clock
from gateway.system.rate_limits import Damped

RETAINED_STOP = Note("retained_stop")
MALFORMED_EVERY_S = 1.0  # events of one kind


@dataclass(frozen=True, slots=True)
class Incoming:
    """A message as the broker delivered it.

    Its response topic counts for nothing: results go to one topic, so that the broker's ACL decides who reads
    them. `expiry_s` and `correlation` come with MQTT 5 only. `is_live` says of a retained one that it was
    published just now, which MQTT 5 alone shows; it means nothing where stored messages were asked for.
    `is_early` says that it came before the connection was reported.
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
    address: CommandAddress,
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
    if address.problem:
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


class IncomingCommands:
    """All calls on the app's loop."""

    def __init__(
        self,
        commands: Commands,
        *,
        clock: Clock,
        publish_event: PublishEvent,
    ) -> None:
        self._commands = commands
        self._publish_event = publish_event
        self._malformed = Damped(self._publish_malformed, clock=clock, every_s=MALFORMED_EVERY_S)

    def take(self, address: CommandAddress, incoming: Incoming, received_s: float) -> None:
        """Pass an operator's message on, or answer why not.

        `address` is what its topic says, `received_s` its arrival on the steady clock.
        """
        received = command_in(address, incoming, received_s, verb_error=self._commands.admission.verb_error)
        self._commands.submit(received.request, received.refusal)
        if received.refusal is not None and received.problem:
            malformed = (received.problem, shortened(incoming.topic, 120), received.refusal.text)
            self._malformed.put(received.problem, malformed)

    def _publish_malformed(self, malformed: tuple[str, str, str], count: int) -> None:
        problem, topic, why = malformed
        self._publish_event(
            EventCode.MALFORMED_TOPIC,
            "several" if count else "one",
            problem=problem,
            topic=topic,
            count=max(count, 1),
            why=why,
        )
