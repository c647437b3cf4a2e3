"""What the journal says of starters and commands: one line for each thing that happened, with its name.

Events and final results are logged here and nowhere else, so that nothing is logged twice.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from gateway.contract import (
    AvailabilityRecord,
    EventCode,
    EventRecord,
    Phase,
    Record,
    ResultRecord,
    Severity,
    Sink,
)
from gateway.system.clock import Clock

log = logging.getLogger("gateway")

MOST_UNDER_WAY = 1000  # commands of which is known when they were accepted
SAID_BY_RESULT = frozenset(
    {EventCode.STOP_UNCONFIRMED, EventCode.LOCKED, EventCode.UNLOCKED, EventCode.IDENTITY_ACCEPTED}
)
NOT_YET_READ = "not yet read"  # a starter's reason before anything is known of it

_LEVELS = {
    Severity.INFO: logging.INFO,
    Severity.WARNING: logging.WARNING,
    Severity.ERROR: logging.ERROR,
    Phase.CONFIRMED: logging.INFO,
    Phase.REJECTED: logging.WARNING,
    Phase.FAILED: logging.ERROR,
    Phase.UNCONFIRMED: logging.ERROR,
}


class RecordLog:
    """Subscribes to the records, and logs what an operator wants to know."""

    takes = (EventRecord, ResultRecord, AvailabilityRecord)

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._accepted_s: OrderedDict[tuple[str, str, str | None], float] = OrderedDict()
        self._answered: set[str] = set()  # starters that were online once: events say what follows
        self._unanswered: dict[str, str | None] = {}  # by starter: why it does not answer, as logged last

    def put(self, record: Record) -> None:
        """Take one record."""
        match record:
            case EventRecord():
                self._log_event(record)
            case ResultRecord():
                self._log_result(record)
            case AvailabilityRecord():
                self._log_first_answer(record)
            case _:
                pass

    def _log_event(self, event: EventRecord) -> None:
        # Of a refused reload each mistake is logged where it is found.
        if event.code not in SAID_BY_RESULT | {EventCode.RELOAD_REFUSED}:
            text = _line(event.starter, event.text)
            log.log(_LEVELS[event.severity], "%s%s", text, _frames(event.data))

    def _log_result(self, result: ResultRecord) -> None:
        """Log the end of a command; of a repeated one nothing is new."""
        key = (result.client, result.starter, result.id)
        now_s = self._clock.now_s()
        if not result.phase.is_final:
            if result.phase is Phase.ACCEPTED:
                self._accepted_s[key] = now_s
                if len(self._accepted_s) > MOST_UNDER_WAY:
                    self._accepted_s.popitem(last=False)
            return
        accepted_s = self._accepted_s.pop(key, None)
        if result.is_duplicate:
            return
        after = "" if accepted_s is None else f" after {now_s - accepted_s:.1f} s"
        what = f"{result.client} {result.verb} {result.starter}: {result.phase}{after}{_outcome(result)}"
        log.log(_LEVELS[result.phase], "%s", _line("", what))

    def _log_first_answer(self, record: AvailabilityRecord) -> None:
        """Log how a starter is found at first; a silence and an answer after it are events."""
        if record.starter in self._answered or record.reason == NOT_YET_READ:
            return
        if record.state in ("online", "degraded"):
            self._answered.add(record.starter)
            log.info("%s", _line(record.starter, "answers"))
        elif record.state == "offline" and self._unanswered.get(record.starter) != record.reason:
            self._unanswered[record.starter] = record.reason
            log.warning("%s", _line(record.starter, f"does not answer: {record.reason}"))


def _outcome(result: ResultRecord) -> str:
    """Return the value that was read or set, or why the command was not carried out."""
    if result.phase is not Phase.CONFIRMED:
        return f": {result.text} [{result.code}]"
    values: Mapping[str, Any] = result.values
    if "parameter" not in values:
        return ""
    value = values.get("label") or f"{values.get('value')} {values.get('unit') or ''}".rstrip()
    return f", {values['parameter']} = {value}"


def _line(starter: str, text: str) -> str:
    """Return a text as one line of printable characters, after the starter's name."""
    printable = "".join(each if each.isprintable() else " " for each in text)
    return f"{starter} {printable.removeprefix('the starter ')}" if starter else printable


def _frames(data: Mapping[str, Any]) -> str:
    frames = data.get("frames")
    return "; last frames:\n" + "\n".join(map(str, frames)) if frames else ""


def log_failure(subscriber: Sink) -> None:
    """Log the exception, while it is handled, by which a subscriber has lost a record."""
    log.exception("subscriber=%s lost a record", type(subscriber).__name__)
