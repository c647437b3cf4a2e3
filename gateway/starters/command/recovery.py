"""What is said of a command that the gateway's own end cut short: once, and it is never carried out again."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import replace

from gateway.contract import CommandRequest, EventCode, Note, Phase, Reason, ResultCode, ResultRecord
from gateway.families import command, state_of
from gateway.starters.command.report import LOOK, MAY_ACT_LATER, MAY_BE_TURNING, Reporting
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
        earlier, state = self._remembered.result, self._state()
        phase, notes = Phase.REJECTED, [Note("nothing_written")]
        if self._remembered.may_be_written:
            phase, notes = Phase.UNCONFIRMED, [Note("may_be_written")]
            notes.append(LOOK if earlier.verb in STILL else MAY_BE_TURNING)
            notes += [MAY_ACT_LATER] if earlier.verb in command.TAKEN_BACK else []
        notes.append(Note("state_unknown") if state == UNKNOWN else Note("state_now", state=state))
        reason = Reason(ResultCode.CRASHED).noted(*notes)
        values = {} if state == UNKNOWN else {"state": state}
        now_s = self._reporting.records.clock.utc_s()
        return replace(earlier, phase=phase, code=reason.code, text=reason.text, time_s=now_s, values=values)

    async def publish(self) -> None:
        """Wait a while for the starter's status, then publish the result, its audit record and an event."""
        reporting = self._reporting
        until_s = reporting.now_s() + STATUS_WITHIN_S
        while self._state() == UNKNOWN and self._starter and reporting.now_s() < until_s:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._hurried.wait(), LOOK_EVERY_S)
                break
        result = self.result()
        latest = reporting.ledger.find(result.client, result.id)
        if latest is not None and latest.code != ResultCode.CRASHED:  # a stop that was done again
            reporting.records.put(result)
        else:
            reporting.ledger.store(result, now_s=reporting.now_s())
            reporting.journal.note(result, then=lambda: reporting.records.put(result))
        request = CommandRequest(result.starter, result.client, result.verb, result.id)
        reporting.audit(request, result.phase, result.code, after=result.values)
        if self._starter is not None and result.phase is Phase.UNCONFIRMED:
            self._starter.emitter.event(
                EventCode.COMMAND_CUT_SHORT,
                client=result.client,
                id=result.id,
                verb=result.verb,
                outcome=result.text,
            )

    def _state(self) -> str:
        if self._starter is None:
            return UNKNOWN
        return state_of(self._starter.profile, self._starter.snapshot.good_values())
