"""Takes what operators send: form and freshness are judged here, everything else by the dispatcher."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

from gateway.contract import (
    CommandAddress,
    CommandError,
    CommandRequest,
    PublishEvent,
    Severity,
    Topics,
    shortened,
)
from gateway.mqtt.commands import CommandParser, Incoming, Rejection
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.freshness import Moment, Tokens
from gateway.system.clock import Clock, ClockWatch
from gateway.system.clock_steps import SETTLED_S
from gateway.system.rate_limits import Damped
from gateway.system.stalls import SuspendWatch

log = logging.getLogger(__name__)

MALFORMED_TOPIC = "malformed_topic"
MALFORMED_EVERY_S = 1.0  # events of one kind


class IncomingCommands:
    """All calls on the app's loop; `restate` publishes the boot token anew, `publish_event` an event."""

    def __init__(
        self,
        topics: Topics,
        tokens: Tokens,
        *,
        dispatcher: Dispatcher,
        clock: Clock,
        clock_watch: ClockWatch,
        restate: Callable[[], None],
        publish_event: PublishEvent,
        suspend_watch: SuspendWatch,
    ) -> None:
        self._parser = CommandParser(topics, tokens, freshness_of=self._freshness_of)
        self._boot = tokens.boot
        self._dispatcher = dispatcher
        self._clock = clock
        self._clock_watch = clock_watch
        self._restate = restate
        self._publish_event = publish_event
        self._suspend_watch = suspend_watch
        suspend_watch.on_suspended = self._note_suspension
        clock_watch.on_change = self._note_clock
        self._malformed = Damped(self._publish_malformed, clock=clock, every_s=MALFORMED_EVERY_S)

    async def run(self) -> None:
        """Watch for suspensions of the process and for steps of the clock."""
        await self._suspend_watch.run(also=self._clock_watch.look)

    def take(self, incoming: Incoming, received_s: float | None = None) -> None:
        """Pass an operator's message on, or answer why not; `received_s` is its arrival (steady clock)."""
        self._suspend_watch.look()  # what has waited must not be judged by the tokens of before
        self._clock_watch.look()
        moment = Moment(self._clock.now_s(), self._clock.utc_s(), self._clock_watch.doubt())
        verdict = self._parser.judge(incoming, moment, received_s=received_s)
        if verdict is None:
            log.debug("topic=%s is no command", shortened(incoming.topic))
            return
        request = verdict.request if isinstance(verdict, Rejection) else verdict
        if isinstance(verdict, Rejection) and verdict.problem:
            self._refuse_malformed(incoming, request, verdict.problem, verdict.error)
            return
        unknown = self._dispatcher.verb_error(request.starter, request.verb)
        if unknown is not None:
            self._refuse_malformed(incoming, request, unknown.code, unknown)
        elif isinstance(verdict, Rejection):
            self._dispatcher.reject(request, verdict.error)
        else:
            self._dispatcher.submit(request)

    def _refuse_malformed(
        self, incoming: Incoming, request: CommandRequest, problem: str, error: CommandError
    ) -> None:
        """Reject what came on a topic that names no command: mistyped, or with an unknown verb."""
        self._dispatcher.reject(request, error)
        self._malformed.put(
            problem, {"problem": problem, "topic": shortened(incoming.topic, 120), "text": error.text}
        )

    def _publish_malformed(self, malformed: Mapping[str, Any], count: int) -> None:
        which = (
            f"{count} more messages came on malformed command topics, the last" if count else "a message came"
        )
        text = f"{which} on {malformed['topic']}: {malformed['text']}"
        data = {"problem": malformed["problem"], "topic": malformed["topic"], "count": max(count, 1)}
        self._publish_event(MALFORMED_TOPIC, Severity.WARNING, text, data)

    def _freshness_of(self, address: CommandAddress) -> tuple[str, ...]:
        return self._dispatcher.freshness(address.client, verb=address.verb, starter=address.starter)

    def _note_suspension(self, seconds: float) -> None:
        """Refuse what was sent before now: it may have waited that long in the broker or a socket."""
        self._boot.stood_still(self._suspend_watch.ended_s())
        self._restate()
        text = f"stood still for {seconds:.1f} s, or the clock was set ahead: what was sent before is refused"
        self._publish_event("stood_still", Severity.WARNING, text)

    def _note_clock(self, step: str | None) -> None:
        """Publish a step of the clock, and that it counts again."""
        if step is None:
            self._publish_event("clock_trusted", Severity.INFO, "the clock is steady: issued_at counts again")
        else:
            text = f"{step}: issued_at does not count for {SETTLED_S:g} s"
            self._publish_event("clock_stepped", Severity.WARNING, text)
