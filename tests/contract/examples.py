"""A start and a trip of a motor, as the contract has them."""

from __future__ import annotations

from gateway.contract import Cause, ReadingTable, StartRecord, TripRecord

START = StartRecord(
    starter="pump",
    id="b-11",
    time_s=0.0,
    boot="b",
    seq=11,
    cause=Cause("command", "alice", "1"),
    outcome="full_voltage",
    acceleration_s=8.12346,
    samples={"t_s": (-1.0, 0.5), "current": (None, 310.0)},
)
TRIP = TripRecord(
    starter="pump",
    id="b-12",
    time_s=0.0,
    boot="b",
    seq=12,
    code="e05",
    text="Overload",
    state_before=None,
    readings=ReadingTable((-1.0, 0.0), {"fault": (False, True)}, {"current": 310.0}),
    at_fault={"P060": {"value": 3}},
    fault_history=(),
)
