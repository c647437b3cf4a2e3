"""A start and a trip of a motor, as the contract has them."""

from __future__ import annotations

from gateway.contract import Cause, StartOutcome, StartRecord, StartSource

START = StartRecord(
    starter="pump",
    id="b-11",
    time_s=0.0,
    boot="b",
    seq=11,
    cause=Cause(StartSource.COMMAND, "alice", "1"),
    outcome=StartOutcome.FULL_VOLTAGE,
    acceleration_s=8.12346,
    samples={"t_s": (-1.0, 0.5), "current": (None, 310.0)},
)
