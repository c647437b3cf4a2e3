"""What happens on a line is handed over in order: results of polls soon, all else at once."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from gateway.line.events import POLLS_WAIT_S, EventQueue, JobDone, LineEvents, PollResult, Trace, deliver
from gateway.line.rtu.outcome import Answered, Outcome, Silent
from gateway.line.scheduler.requests import Job, Priority
from gateway.modbus.reads import ReadHoldingRegisters
from tests.line.fakes import poll
from tests.starters.rig import virtually

STATUS, VALUES = replace(poll("status"), is_urgent=True), poll("values")


class Batches:
    """A line whose events are noted as they are handed over."""

    def __init__(self) -> None:
        self.batches: list[list[Any]] = []
        self.queue = EventQueue(self._take)
        self.line = LineEvents("pumps", self.queue, Trace("pumps"))

    def _take(self, batch: Sequence[tuple[LineEvents, Any]]) -> None:
        self.batches.append([event for _, event in batch])

    def keys(self) -> list[list[str]]:
        return [[event.key for event in batch] for batch in self.batches]


def answered(word: int) -> Answered:
    return Answered((word,), at_s=1.0, response_time_s=0.005)


@virtually
async def test_an_answer_to_an_urgent_poll_that_says_something_new_goes_at_once() -> None:
    here = Batches()
    for word in (1, 1, 2, 2, 1):
        here.line.poll_done(STATUS, answered(word))
        here.line.flush()

    assert here.keys() == [["status"], ["status", "status"], ["status", "status"]]


@virtually
async def test_other_answers_and_silences_wait_for_each_other() -> None:
    here = Batches()
    for word in (1, 2):
        here.line.poll_done(VALUES, answered(word))
        here.line.flush()
    here.line.poll_done(STATUS, Silent())
    here.line.flush()
    assert here.batches == []

    await asyncio.sleep(POLLS_WAIT_S)

    assert here.keys() == [["values", "values", "status"]]


@virtually
async def test_nothing_is_handed_over_before_the_next_request_is_on_the_wire() -> None:
    here = Batches()
    here.line.unit_changed(1, answered(1), is_answering=True)
    await asyncio.sleep(1.0)
    assert here.batches == []

    here.line.flush()

    assert len(here.batches) == 1


@virtually
async def test_of_a_line_that_is_removed_only_the_jobs_are_handled() -> None:
    outcomes: list[Outcome] = []
    handled: list[Any] = []
    queue = EventQueue(lambda batch: deliver(batch, handled.append), polls_wait_s=0.0)
    gone, stays = (LineEvents(name, queue, Trace(name)) for name in ("gone", "stays"))
    job = Job(1, ReadHoldingRegisters(0, 1), 0.1, Priority.COMMAND, outcomes.append)
    for line in (gone, stays):
        line.poll_done(VALUES, Silent())
    gone.job_done(job, Silent())

    gone.is_muted = True
    queue.flush()

    assert handled == [PollResult("stays", "values", 1, Silent())]
    assert outcomes == [Silent()]
    assert JobDone(job, Silent()).job is job
