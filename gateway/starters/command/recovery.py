"""What is said of a command that the gateway's own end cut short: once, and it is never carried out again."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import replace

from gateway.contract import CommandRequest, EventCode, Note, Phase, Reason, ResultCode, ResultRecord
from gateway.families import command, state_of
from gateway.starters.command.report import Reporting, audit
from gateway.starters.command.run.ends import LOOK, MAY_ACT_LATER, MAY_BE_TURNING
from gateway.starters.view import StarterIo
from gateway.store import Remembered

STILL = ("read", "output")  # verbs that cannot move a motor whatever became of them
UNKNOWN = "unknown"  # the state of a starter that has not been read
STATUS_WITHIN_S = 10.0
LOOK_EVERY_S = 0.25


class Recovery:
    """One such command; until its end is published, the ledger answers a repetition with what is known."""

    def __init__(self, remembered: Remembered, starter: StarterIo | None, reporting: Reporting) -> None:
        self._remembered = remembered
        self._starter = starter  # None: it is configured no more
        self._reporting = reporting
        self._hurried = asyncio.Event()

    def hurry(self) -> None:
        """Wait no longer for a status."""
        self._hurried.set()

    def result(self) -> ResultRecord:
        """Return the command's final result as far as it is known now."""
        verb, state = self._remembered.result.verb, self._state()
        if self._remembered.may_be_written:
            outlook = LOOK if verb in STILL else MAY_BE_TURNING
            notes = [Note("may_be_written"), outlook, MAY_ACT_LATER if verb in command.TAKEN_BACK else None]
            phase = Phase.UNCONFIRMED
        else:
            notes = [Note("nothing_written")]
            phase = Phase.REJECTED
        now = Note("state_unknown") if state == UNKNOWN else Note("state_now", state=state)
        reason = Reason(ResultCode.CRASHED).noted(*notes, now)
        earlier = self._remembered.result
        values = {} if state == UNKNOWN else {"state": state}
        now_s = self._reporting.records.clock.utc_s()
        return replace(earlier, phase=phase, code=reason.code, text=reason.text, time_s=now_s, values=values)

    async def publish(self) -> None:
        """Wait a while for the starter's status, then publish the result, its audit record and an event."""
        until_s = self._reporting.records.clock.now_s() + STATUS_WITHIN_S
        while self._state() == UNKNOWN and self._starter and self._reporting.records.clock.now_s() < until_s:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._hurried.wait(), LOOK_EVERY_S)
                break
        result = self.result()
        if self._is_superseded():
            self._reporting.records.put(result)
        else:
            self._reporting.ledger.store(result, now_s=self._reporting.records.clock.now_s())
            self._reporting.journal.note(result, then=lambda: self._reporting.records.put(result))
        request = CommandRequest(result.starter, result.client, result.verb, result.id)
        records = self._reporting.records
        audit(request, records, decision=result.phase, code=result.code, after=result.values)
        if self._starter is not None and result.phase is Phase.UNCONFIRMED:
            self._starter.emitter.event(
                EventCode.COMMAND_CUT_SHORT,
                client=result.client,
                id=result.id,
                verb=result.verb,
                outcome=result.text,
            )

    def _is_superseded(self) -> bool:
        """Return whether the id stands for something newer by now: a stop that was done again."""
        latest = self._reporting.ledger.find(self._remembered.result.client, self._remembered.result.id)
        return latest is not None and latest.code != ResultCode.CRASHED

    def _state(self) -> str:
        if self._starter is None:
            return UNKNOWN
        return state_of(self._starter.profile, self._starter.snapshot.good_values())
