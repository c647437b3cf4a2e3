"""Commands as MQTT brings them: what is on no topic of a command is answered here, all else is submitted."""

from __future__ import annotations

from collections.abc import Mapping

from gateway.contract import CommandAddress, EventCode, Malformed, PublishEvent, shortened
from gateway.mqtt.commands import Incoming, command_in
from gateway.starters import Commands, Dispatcher
from gateway.system.clock import Clock
from gateway.system.rate_limits import Damped

MALFORMED_EVERY_S = 1.0  # events of one kind


class IncomingCommands:
    """All calls on the app's loop."""

    def __init__(
        self,
        commands: Commands,
        *,
        dispatcher: Dispatcher,
        clock: Clock,
        publish_event: PublishEvent,
    ) -> None:
        self._commands = commands
        self._dispatcher = dispatcher
        self._publish_event = publish_event
        self._malformed = Damped(self._publish_malformed, clock=clock, every_s=MALFORMED_EVERY_S)

    def take(self, address: CommandAddress | Malformed, incoming: Incoming, received_s: float) -> None:
        """Pass an operator's message on, or answer why not.

        `address` is what its topic says, `received_s` its arrival on the steady clock.
        """
        self._commands.look()
        received = command_in(address, incoming, received_s, verb_error=self._dispatcher.verb_error)
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
