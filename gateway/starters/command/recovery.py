"""What is said of a command that the gateway's own end cut short: once, and it is never carried out again."""

from __future__ import annotations

from dataclasses import replace

from gateway.contract import CommandRequest, EventCode, Note, Phase, Reason, ResultCode, ResultRecord
from gateway.families import command
from gateway.starters.command.report import LOOK, MAY_ACT_LATER, MAY_BE_TURNING, Reporting
from gateway.starters.view import StarterIo
from gateway.store import Remembered

STILL = ("read", "output")  # verbs that cannot move a motor whatever became of them


def end_of(remembered: Remembered, *, utc_s: float) -> ResultRecord:
    """Return the final result of a command that was under way when the gateway ended."""
    earlier, phase, notes = remembered.result, Phase.REJECTED, [Note("nothing_written")]
    if remembered.may_be_written:
        phase, notes = Phase.UNCONFIRMED, [Note("may_be_written")]
        notes.append(LOOK if earlier.verb in STILL else MAY_BE_TURNING)
        notes += [MAY_ACT_LATER] if earlier.verb in command.TAKEN_BACK else []
    reason = Reason(ResultCode.CRASHED).noted(*notes)
    return replace(earlier, phase=phase, code=reason.code, text=reason.text, time_s=utc_s, values={})


def publish_end(result: ResultRecord, starter: StarterIo | None, reporting: Reporting) -> None:
    """Publish such a result, its audit record, and an event where something may be written."""
    reporting.journal.note(result, then=lambda: reporting.records.put(result))
    request = CommandRequest(result.starter, result.client, result.verb, result.id)
    reporting.audit(request, result.phase, result.code)
    if starter is not None and result.phase is Phase.UNCONFIRMED:
        starter.emitter.event(
            EventCode.COMMAND_CUT_SHORT,
            client=result.client,
            id=result.id,
            verb=result.verb,
            outcome=result.text,
        )
