"""What is counted of records, and what a client cannot do to the counters."""

from __future__ import annotations

from typing import Any

from gateway.plugins.metrics.counts import RecordCounts
from gateway.contract import Phase, Quality, ResultRecord, ValueRecord

VERBS = frozenset({"start", "stop"})


def result(phase: Phase, *, code: str = "ok", verb: str = "start", id_: str | None = "1", **more: Any) -> Any:
    return ResultRecord(starter="pump-1", client="alice", id=id_, verb=verb, phase=phase, code=code, text="", time_s=0.0, **more)


def counts(*, has_own_values: bool = False) -> RecordCounts:
    return RecordCounts(VERBS, has_own_values=has_own_values)


def test_each_phase_is_counted_and_the_time_to_the_final_one() -> None:
    here = counts()

    here.put(result(Phase.ACCEPTED), 10.0)
    here.put(result(Phase.WRITTEN), 10.1)
    here.put(result(Phase.CONFIRMED), 10.3)

    taken = here.taken()
    phases = ("accepted", "written", "confirmed")
    assert taken.commands == {("start", phase, "ok"): 1 for phase in phases}
    assert taken.command_times["start"].within[-1] == 1
    assert abs(taken.command_times["start"].total_s - 0.3) < 1e-9


def test_verbs_that_clients_invent_make_one_series() -> None:
    here = counts()

    for number in range(500):
        here.put(result(Phase.REJECTED, code="unknown_verb", verb=f"verb_{number}"), 1.0)

    assert here.taken().commands == {("other", "rejected", "unknown_verb"): 500}


def test_values_are_retained_only_of_the_gateways_own_points_and_only_when_they_are_exported() -> None:
    own = ValueRecord(starter="pump-1", point="hours_total", value=3.5, unit="h", quality=Quality.GOOD, time_s=0.0, seq=1)
    stale = ValueRecord(starter="pump-1", point="energy_kwh", value=3.5, unit="kWh", quality=Quality.STALE, time_s=0.0, seq=1)
    other = ValueRecord(starter="pump-1", point="current", value=3.5, unit="A", quality=Quality.GOOD, time_s=0.0, seq=1)
    without, with_all = counts(), counts(has_own_values=True)

    for each in (own, stale, other):
        without.put(each, 0.0)
        with_all.put(each, 0.0)

    assert without.taken().own_values == {}
    assert with_all.taken().own_values == {("pump-1", "hours_total"): own}
    with_all.want_own_values(has_own_values=False)
    assert with_all.taken().own_values == {}
