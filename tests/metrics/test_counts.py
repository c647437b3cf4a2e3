"""What is counted of records, and what a client cannot do to the counters."""

from __future__ import annotations

from typing import Any

from gateway.contract import Phase, ResultRecord
from gateway.plugins.metrics.counts import RecordCounts

VERBS = frozenset({"start", "stop"})


def result(phase: Phase, *, code: str = "ok", verb: str = "start", id_: str | None = "1", **more: Any) -> Any:
    return ResultRecord(
        starter="pump-1",
        client="alice",
        id=id_,
        verb=verb,
        phase=phase,
        code=code,
        text="",
        time_s=0.0,
        **more,
    )


def test_each_phase_is_counted_and_the_time_to_the_final_one() -> None:
    here = RecordCounts(VERBS)

    here.put(result(Phase.ACCEPTED), 10.0)
    here.put(result(Phase.WRITTEN), 10.1)
    here.put(result(Phase.CONFIRMED), 10.3)

    taken = here.taken()
    phases = ("accepted", "written", "confirmed")
    assert taken.counts["commands_total"] == {("start", phase, "ok"): 1 for phase in phases}
    assert taken.times["start"].within[-1] == 1
    assert abs(taken.times["start"].total_s - 0.3) < 1e-9


def test_verbs_that_clients_invent_make_one_series() -> None:
    here = RecordCounts(VERBS)

    for number in range(500):
        here.put(result(Phase.REJECTED, code="unknown_verb", verb=f"verb_{number}"), 1.0)

    assert here.taken().counts["commands_total"] == {("other", "rejected", "unknown_verb"): 500}
