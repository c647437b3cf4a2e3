"""What makes proofs of freshness void: a standstill of the gateway, and a step of the clock they are read by.

Either is noticed before the next command is dated by its proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gateway.contract import CommandRequest, EventCode, PublishEvent
from gateway.starters.policy.freshness import BY_TOKEN, ArrivalTime, Tokens, dated
from gateway.starters.policy.rights import Rights
from gateway.system.clock import SETTLED_S, Clock, ClockWatch
from gateway.system.stalls import SuspendWatch


@dataclass(eq=False, kw_only=True)
class Proofs:
    """Dates commands by their proofs, on the app's loop; `restate` publishes the boot token again."""

    tokens: Tokens
    clock: Clock
    clock_watch: ClockWatch
    suspend_watch: SuspendWatch
    restate: Callable[[], None]
    publish_event: PublishEvent

    def __post_init__(self) -> None:
        self.suspend_watch.on_suspended = self._note_suspension
        self.clock_watch.on_change = self._note_clock

    async def run(self) -> None:
        """Watch for suspensions of the process and for steps of the clock."""
        await self.suspend_watch.run(also=self.clock_watch.look)

    def dated(self, request: CommandRequest, rights: Rights) -> CommandRequest:
        """Return a fresh command with the time at which it was decided upon; CommandError for others."""
        self.suspend_watch.look()
        self.clock_watch.look()
        freshness = rights.freshness(request.client, verb=request.verb, starter=request.starter)
        if request.source:
            freshness = (BY_TOKEN,)  # no bridge lies before a part of the gateway
        moment = ArrivalTime(self.clock.now_s(), self.clock.utc_s(), self.clock_watch.doubt())
        return dated(request, freshness=freshness, tokens=self.tokens, moment=moment)

    def _note_suspension(self, seconds: float) -> None:
        """Refuse what was sent before now: it may have waited that long in the broker or a socket."""
        self.tokens.stood_still(self.suspend_watch.ended_s())
        self.restate()
        self.publish_event(EventCode.STOOD_STILL, seconds=seconds)

    def _note_clock(self, step: str | None) -> None:
        """Publish a step of the clock, and that it counts again."""
        if step is None:
            self.publish_event(EventCode.CLOCK_TRUSTED)
        else:
            self.publish_event(EventCode.CLOCK_STEPPED, step=step, seconds=SETTLED_S)
