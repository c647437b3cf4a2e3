"""What a flood of jobs leaves of a line: to polls, to watchdogs, to other jobs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from gateway.line.scheduler.line_time import JOBS_SHARE
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.scheduler import BACKGROUND_WEIGHT, Scheduler
from gateway.modbus.reads import ReadHoldingRegisters
from tests.line.fakes import poll
from tests.line.ideal_line import IdealLine

TOOK_S = 0.025  # one transaction at 19200 bit/s
UNDER_WAY = 16  # commands that wait for this line at the same time
READ = ReadHoldingRegisters(0, 1)
FLOODING = 99  # a unit: another job follows each of its jobs


def job(lane: Priority) -> Job:
    return Job(FLOODING, READ, 0.01, lane, lambda outcome: None)


def flooded(polls: Sequence[Poll], lanes: Sequence[Priority], *, seconds: float = 120.0) -> IdealLine:
    """Serve a line on which a job of each lane waits at any moment, several of the last."""
    line = IdealLine(polls, lambda slot: _took_s(line.scheduler, slot, lambda: line.now_s))
    for lane in lanes:
        for _ in range(UNDER_WAY):
            line.scheduler.jobs.submit(job(lane), 0.0)
    line.run(seconds)
    return line


def _took_s(scheduler: Scheduler, slot: Slot, now_s: Callable[[], float]) -> float:
    if slot.jobs and slot.jobs[0].unit == FLOODING:
        scheduler.jobs.submit(job(slot.jobs[0].lane), now_s())
    return TOOK_S


def per_s(line: IdealLine, key: str) -> float:
    return 1 / (sum(line.gaps_s[key]) / len(line.gaps_s[key]))


def used_by(line: IdealLine, lane: Priority) -> float:
    """Return the share of the line's time that a lane has used."""
    slots = [slot for _, slot in line.slots if slot.jobs and slot.jobs[0].lane is lane]
    return len(slots) * TOOK_S / line.now_s


def test_a_flood_of_reads_and_settings_leaves_a_busy_lines_polls_their_rates() -> None:
    polls = [poll(f"{unit}", unit=unit, every_s=0.3) for unit in range(1, 9)]  # two thirds of the line

    line = flooded(polls, [Priority.PARAMETERS])

    assert min(per_s(line, each.key) for each in polls) > 0.95 / 0.3
    assert max(max(line.gaps_s[each.key]) for each in polls) < 0.3 + 0.35
    assert used_by(line, Priority.PARAMETERS) > 0.2


def test_an_over_full_line_gives_a_flood_of_reads_a_quarter_and_no_more() -> None:
    polls = [poll(f"{unit}", unit=unit, every_s=0.1) for unit in range(1, 9)]  # twice what the line can

    line = flooded(polls, [Priority.PARAMETERS])

    assert used_by(line, Priority.PARAMETERS) == pytest.approx(JOBS_SHARE / BACKGROUND_WEIGHT, abs=0.03)
    calm_s = 8 * TOOK_S
    assert max(max(line.gaps_s[each.key]) for each in polls) < 3 * calm_s
