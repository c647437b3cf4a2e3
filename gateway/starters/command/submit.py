"""`Commands.submit`: the one way in for commands, whether they come by MQTT, the page or Sparkplug.

1. A stop is passed on at once. Every other command is judged fresh first, by the proof that it carries.
2. Who sent it may follow its results, which are published as well: `async for result in submit(...)`.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import AsyncIterator, Callable
from dataclasses import KW_ONLY, dataclass, replace
from weakref import WeakValueDictionary

from gateway.contract import STOP, CommandError, CommandRequest, EventCode, PublishEvent, Record, ResultRecord
from gateway.starters.command.dispatcher import Dispatcher
from gateway.starters.policy.freshness import BY_TOKEN, ArrivalTime, Tokens, dated
from gateway.system.clock import SETTLED_S, Clock, ClockWatch
from gateway.system.stalls import SuspendWatch

Results = AsyncIterator[ResultRecord]  # of one command as they come, up to the final one
_Came = asyncio.Queue[ResultRecord]


async def _followed(came: _Came) -> Results:
    """Return results as they come.

    Of a group's stop these are the group's own: its members' results have no ticket.
    """
    is_over = False
    while not is_over:
        result = await came.get()
        is_over = result.phase.is_final
        yield result


@dataclass(eq=False)
class Commands:
    """Takes every command. All calls on the app's loop; `restate` publishes the boot token again."""

    takes = (ResultRecord,)

    dispatcher: Dispatcher
    tokens: Tokens
    _: KW_ONLY
    clock: Clock
    clock_watch: ClockWatch
    suspend_watch: SuspendWatch
    restate: Callable[[], None]
    publish_event: PublishEvent

    def __post_init__(self) -> None:
        self._tickets = itertools.count(1)
        self._followed: WeakValueDictionary[int, _Came] = WeakValueDictionary()
        self.suspend_watch.on_suspended = self._note_suspension
        self.clock_watch.on_change = self._note_clock

    async def run(self) -> None:
        """Watch for suspensions of the process and for steps of the clock."""
        await self.suspend_watch.run(also=self.clock_watch.look)

    def submit(self, request: CommandRequest, refusal: CommandError | None = None) -> Results:
        """Judge a command at once and have it carried out; what has no proof of freshness is rejected.

        One that comes with a refusal is not fit to be judged; a repetition gets the first one's result.
        """
        came = _Came()
        request = replace(request, ticket=next(self._tickets))
        self._followed[request.ticket] = came
        refusal = refusal or self.dispatcher.verb_error(request.starter, request.verb)
        if refusal is None and request.verb != STOP:
            try:
                request = self._decided(request)
            except CommandError as unproven:
                refusal = unproven
        self.dispatcher.submit(request, refusal)
        return _followed(came)

    def put(self, record: Record) -> None:
        """Hand a result to who follows its command."""
        if isinstance(record, ResultRecord) and (came := self._followed.get(record.ticket)):
            came.put_nowait(record)

    def look(self) -> None:
        """Notice a standstill or a step of the clock before anything that has waited meanwhile is judged."""
        self.suspend_watch.look()
        self.clock_watch.look()

    def _decided(self, request: CommandRequest) -> CommandRequest:
        """Return a fresh command with the time at which it was decided upon; CommandError for others."""
        self.look()
        rights, client, verb = self.dispatcher.policy.rights, request.client, request.verb
        granted = rights.freshness(client, verb=verb, starter=request.starter)
        return dated(
            request,
            freshness=(BY_TOKEN,)
            if request.source
            else granted,  # no bridge lies before a part of the gateway
            tokens=self.tokens,
            moment=ArrivalTime(self.clock.now_s(), self.clock.utc_s(), self.clock_watch.doubt()),
        )

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
