"""Commands as MQTT brings them: what is on no topic of a command is answered here, all else is submitted."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from gateway.contract import EventCode, PublishEvent, Topics, shortened
from gateway.mqtt.commands import Incoming, command_in
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.commands.submit import Commands
from gateway.system.clock import Clock
from gateway.system.rate_limits import Damped

log = logging.getLogger(__name__)

MALFORMED_EVERY_S = 1.0  # events of one kind


class IncomingCommands:
    """All calls on the app's loop."""

    def __init__(
        self,
        topics: Topics,
        commands: Commands,
        *,
        dispatcher: Dispatcher,
        clock: Clock,
        publish_event: PublishEvent,
    ) -> None:
        self._topics = topics
        self._commands = commands
        self._dispatcher = dispatcher
        self._clock = clock
        self._publish_event = publish_event
        self._malformed = Damped(self._publish_malformed, clock=clock, every_s=MALFORMED_EVERY_S)

    def take(self, incoming: Incoming, received_s: float | None = None) -> None:
        """Pass an operator's message on, or answer why not; `received_s` is its arrival (steady clock)."""
        self._commands.look()
        came_s = self._clock.now_s() if received_s is None else received_s
        received = command_in(self._topics, incoming, came_s, verb_error=self._dispatcher.verb_error)
        if received is None:
            log.debug("topic=%s is no command", shortened(incoming.topic))
            return
        self._commands.submit(received.request, received.refusal)
        if received.refusal is not None and received.problem:
            malformed = {
                "problem": received.problem,
                "topic": shortened(incoming.topic, 120),
                "why": received.refusal.text,
            }
            self._malformed.put(received.problem, malformed)

    def _publish_malformed(self, malformed: Mapping[str, str], count: int) -> None:
        self._publish_event(
            EventCode.MALFORMED_TOPIC,
            "several" if count else "one",
            problem=malformed["problem"],
            topic=malformed["topic"],
            count=max(count, 1),
            why=malformed["why"],
        )
