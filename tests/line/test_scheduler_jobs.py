"""Jobs and repetitions among the polls."""

from __future__ import annotations

from gateway.line.scheduler.line_time import JOBS_BURST_S, JOBS_SHARE
from gateway.line.scheduler.requests import Priority
from tests.line.fakes import poll
from tests.line.scheduled import ANSWERED, READ, begun, job, take


def test_jobs_use_what_they_have_saved_up_and_then_every_other_slot() -> None:
    scheduler = begun(poll("a", every_s=0.0))
    take(scheduler, 0.0)
    for _ in range(60):
        scheduler.jobs.submit(job(), 0.0)

    now_s, kinds = 0.0, ""
    for _ in range(60):
        slot = scheduler.pick(now_s)
        assert slot is not None
        kinds += "p" if not slot.jobs else "j"
        now_s += 0.05
        scheduler.record(slot, ANSWERED, now_s)

    saved = round(JOBS_BURST_S / JOBS_SHARE / 0.05)
    assert kinds[: saved - 1] == "j" * (saved - 1)
    assert kinds[saved + 2 :] in ("jp" * 60, "pj" * 60) or kinds[saved + 2 :] in "jp" * 60


def test_time_in_which_a_job_may_not_be_sent_is_not_charged() -> None:
    scheduler = begun(poll("a", every_s=10.0))
    take(scheduler, 0.0)
    scheduler.jobs.submit(job(Priority.READ_BACK, request=READ), 1.0)
    slot = scheduler.pick(1.0)
    assert slot is not None
    scheduler.put_back(slot, 2.0)

    slot = scheduler.pick(2.0)
    assert slot is not None
    scheduler.record(slot, ANSWERED, 2.1)

    assert scheduler.jobs.budget.room_at_s <= 2.1
