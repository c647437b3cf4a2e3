"""Takes what operators send: judged by its form and freshness here, by the commander after that."""

from __future__ import annotations

import logging
from collections.abc import Callable

from gateway.clock import Clock, ClockWatch
from gateway.mqtt.freshness import Moment, Tokens
from gateway.mqtt.intake import Incoming, Intake, Rejection
from gateway.mqtt.topics import CommandAddress, Topics
from gateway.standstill import StandstillWatch
from gateway.starters.commander import Commander
from gateway.starters.records import Severity

log = logging.getLogger(__name__)

Tell = Callable[[str, Severity, str], None]


class Reception:
    """All calls on the app's loop; `restate` publishes the boot token anew, `tell` an event."""

    def __init__(
        self,
        topics: Topics,
        tokens: Tokens,
        *,
        commander: Commander,
        clock: Clock,
        clock_watch: ClockWatch,
        restate: Callable[[], None],
        tell: Tell,
        standstill: Callable[[Callable[[float], None]], StandstillWatch] = StandstillWatch,
    ) -> None:
        self._intake = Intake(topics, tokens, freshness_of=self._freshness_of)
        self._boot = tokens.boot
        self._commander = commander
        self._clock = clock
        self._clock_watch = clock_watch
        self._restate = restate
        self._tell = tell
        self._standstill = standstill(self._note_standstill)

    async def run(self) -> None:
        """Watch for standstills and for steps of the clock, for ever."""
        await self._standstill.run(also=self._clock_watch.look)

    def take(self, incoming: Incoming) -> None:
        """Pass an operator's message on, or tell its sender why not."""
        self._standstill.look()  # what has waited must not be judged by the tokens of before
        self._clock_watch.look()
        moment = Moment(self._clock.now_s(), self._clock.utc_s(), self._clock_watch.doubt())
        verdict = self._intake.judge(incoming, moment)
        match verdict:
            case Rejection():
                self._commander.reject(verdict, verdict.code, verdict.text)
            case None:
                log.debug("topic=%s is no command", incoming.topic[:200])
            case _:
                self._commander.submit(verdict)

    def _freshness_of(self, address: CommandAddress) -> tuple[str, ...]:
        return self._commander.freshness(address.client, verb=address.verb, starter=address.starter)

    def _note_standstill(self, seconds: float) -> None:
        """Refuse what was sent before now: it may have waited as long, in the broker or in our own socket."""
        self._boot.stood_still(self._clock.now_s())
        self._restate()
        text = f"stood still for {seconds:.1f} s, or the clock was set ahead: what was sent before is refused"
        log.warning("%s", text)
        self._tell("stood_still", Severity.WARNING, text)
