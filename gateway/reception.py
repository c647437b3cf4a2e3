"""Takes what operators send: judged by its form and freshness here, by the commander after that."""

from __future__ import annotations

import logging
from collections.abc import Callable

from gateway.clock import Clock, ClockWatch
from gateway.mqtt.boot import Boot
from gateway.mqtt.intake import Incoming, Intake, Rejection
from gateway.mqtt.topics import Topics
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
        boot: Boot,
        *,
        commander: Commander,
        clock: Clock,
        clock_watch: ClockWatch,
        restate: Callable[[], None],
        tell: Tell,
        standstill: Callable[[Callable[[float], None]], StandstillWatch] = StandstillWatch,
    ) -> None:
        self._intake = Intake(topics, boot)
        self._boot = boot
        self._commander = commander
        self._clock = clock
        self._clock_watch = clock_watch
        self._restate = restate
        self._tell = tell
        self._standstill = standstill(self._note_standstill)

    async def run(self) -> None:
        """Watch for standstills for ever."""
        await self._standstill.run()

    def take(self, incoming: Incoming, received_s: float | None = None) -> None:
        """Pass an operator's message on, or tell its sender why not; `received_s` is on the steady clock."""
        self._standstill.look()  # what has waited must not be judged by the token of before
        verdict = self._intake.judge(
            incoming,
            utc_s=self._clock.utc_s(),
            received_s=self._clock.now_s() if received_s is None else received_s,
            clock_is_synchronised=self._clock_watch.is_synchronised(),
        )
        match verdict:
            case Rejection():
                self._commander.reject(verdict, verdict.code, verdict.text)
            case None:
                log.debug("topic=%s is no command", incoming.topic[:200])
            case _:
                self._commander.submit(verdict)

    def _note_standstill(self, seconds: float) -> None:
        """Refuse what was sent before now: it may have waited as long, in the broker or in our own socket."""
        self._boot.stood_still(self._clock.now_s())
        self._restate()
        text = f"stood still for {seconds:.1f} s, or the clock was set ahead: what was sent before is refused"
        log.warning("%s", text)
        self._tell("stood_still", Severity.WARNING, text)
