"""The lanes of stops: what is shared, what is held, what lets watchdogs pass."""

from __future__ import annotations

import pytest

from gateway.line.rtu.outcome import Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.line.scheduler.scheduler import IN_ROW
from tests.line.fakes import poll
from tests.line.scheduled import ANSWERED, GARBLED, READ, begun, job, take

SILENT, NOT_SENT = Silent("no reply"), Silent("the line is never quiet", is_sent=False)


@pytest.mark.parametrize(
    ("outcome", "kinds"), [(SILENT, "fp" * 6), (GARBLED, "fp" * 6), (NOT_SENT, "f" * IN_ROW + "pfff")]
)
def test_after_a_read_back_without_an_answer_something_else_goes_first(outcome: Outcome, kinds: str) -> None:
    scheduler = begun(*(poll(str(unit), unit=unit, every_s=0.0) for unit in range(1, 31)))
    for _ in range(31):
        take(scheduler, 0.0)
    for _ in range(40):
        scheduler.jobs.submit(job(Priority.FOLLOW_UP, unit=99, request=READ), 8.0)

    now_s, seen = 8.0, ""
    while len(seen) < len(kinds):
        slot = scheduler.pick(now_s)
        assert slot is not None
        seen += "f" if slot.jobs else "p"
        now_s += 0.05
        scheduler.record(slot, outcome if slot.jobs else ANSWERED, now_s)

    assert seen == kinds


def test_follow_ups_and_watchdogs_that_are_due_alternate_and_let_a_poll_pass() -> None:
    units = range(1, 31)
    scheduler = begun(*(poll(str(unit), unit=unit, every_s=0.0) for unit in units))
    for unit in units:
        scheduler.polls.set_deadline(unit, 10.0)
    for _ in range(31):
        take(scheduler, 0.0)
    for _ in range(40):
        scheduler.jobs.submit(job(Priority.FOLLOW_UP, unit=99, request=READ), 8.0)

    now_s, kinds = 8.0, ""
    for _ in range(40):
        slot = scheduler.pick(now_s)
        assert slot is not None
        kinds += "p" if not slot.jobs else "f"
        now_s += 0.05
        scheduler.record(slot, ANSWERED, now_s)

    assert kinds == ("f" * IN_ROW + "p" * (IN_ROW + 1)) * 2 + "f" * 6
