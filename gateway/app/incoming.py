"""Takes what operators send: judged by its form and freshness here, by the commander after that."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from gateway.mqtt.contract.commands import MALFORMED_TOPIC, CommandParser, Incoming, Rejection
from gateway.mqtt.contract.freshness import Moment, Tokens
from gateway.mqtt.contract.topics import CommandAddress, Topics, shortened
from gateway.records import Severity
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.request import CommandRequest
from gateway.system.clock import Clock, ClockWatch
from gateway.system.suspend_watch import SuspendWatch
from gateway.system.token_bucket import Damped

log = logging.getLogger(__name__)

MALFORMED_EVERY_S = 1.0  # events of one kind


class Tell(Protocol):
    """Publishes an event of the gateway's own."""

    def __call__(
        self, code: str, severity: Severity, text: str, data: Mapping[str, Any] | None = None, /
    ) -> None:
        """Take its code, severity, text and data."""
        ...


class IncomingCommands:
    """All calls on the app's loop; `restate` publishes the boot token anew, `tell` an event."""

    def __init__(
        self,
        topics: Topics,
        tokens: Tokens,
        *,
        commander: Dispatcher,
        clock: Clock,
        clock_watch: ClockWatch,
        restate: Callable[[], None],
        tell: Tell,
        standstill: SuspendWatch,
    ) -> None:
        self._intake = CommandParser(topics, tokens, freshness_of=self._freshness_of)
        self._boot = tokens.boot
        self._commander = commander
        self._clock = clock
        self._clock_watch = clock_watch
        self._restate = restate
        self._tell = tell
        self._standstill = standstill
        standstill.on_standstill = self._note_standstill
        self._malformed = Damped(self._tell_malformed, clock=clock, every_s=MALFORMED_EVERY_S)

    async def run(self) -> None:
        """Watch for standstills and for steps of the clock, for ever."""
        await self._standstill.run(also=self._clock_watch.look)

    def take(self, incoming: Incoming, received_s: float | None = None) -> None:
        """Pass an operator's message on, or answer why not; `received_s` is its arrival (steady clock)."""
        self._standstill.look()  # what has waited must not be judged by the tokens of before
        self._clock_watch.look()
        moment = Moment(self._clock.now_s(), self._clock.utc_s(), self._clock_watch.doubt())
        verdict = self._intake.judge(incoming, moment, received_s=received_s)
        if verdict is None:
            log.debug("topic=%s is no command", shortened(incoming.topic))
            return
        if isinstance(verdict, Rejection) and verdict.problem:
            self._refuse_malformed(incoming, verdict, verdict.problem, verdict.code, verdict.text)
            return
        unknown = self._commander.verb_error(verdict.starter, verdict.verb)
        if unknown is not None:
            self._refuse_malformed(incoming, verdict, unknown.code, unknown.code, unknown.text)
        elif isinstance(verdict, Rejection):
            self._commander.reject(verdict, verdict.code, verdict.text)
        else:
            self._commander.submit(verdict)

    def _refuse_malformed(
        self, incoming: Incoming, verdict: Rejection | CommandRequest, problem: str, code: str, text: str
    ) -> None:
        """Answer what came on a topic that names no command: mistyped, or with a verb that does not exist."""
        self._commander.reject(verdict, code, text)
        self._malformed.put(
            problem, {"problem": problem, "topic": shortened(incoming.topic, 120), "text": text}
        )

    def _tell_malformed(self, malformed: Mapping[str, Any], count: int) -> None:
        which = (
            f"{count} more messages came on malformed command topics, the last" if count else "a message came"
        )
        text = f"{which} on {malformed['topic']}: {malformed['text']}"
        data = {"problem": malformed["problem"], "topic": malformed["topic"], "count": max(count, 1)}
        self._tell(MALFORMED_TOPIC, Severity.WARNING, text, data)

    def _freshness_of(self, address: CommandAddress) -> tuple[str, ...]:
        return self._commander.freshness(address.client, verb=address.verb, starter=address.starter)

    def _note_standstill(self, seconds: float) -> None:
        """Refuse what was sent before now: it may have waited as long, in the broker or in our own socket."""
        self._boot.stood_still(self._standstill.ended_s())
        self._restate()
        text = f"stood still for {seconds:.1f} s, or the clock was set ahead: what was sent before is refused"
        self._tell("stood_still", Severity.WARNING, text)
