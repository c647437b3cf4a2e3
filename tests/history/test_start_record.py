"""The record of a start and its JSON."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.contract import Cause, QuantityChange, StartOutcome, StartRecord, StartSource, read_stored

START = StartRecord(
    starter="pump",
    id="0123abcd-71",
    time_s=1_795_222_923.456,
    boot="0123abcd",
    seq=71,
    outcome=StartOutcome.FULL_VOLTAGE,
    cause=Cause(StartSource.COMMAND, "alice", "c1"),
    standstill_s=3600.0,
    rate_hz=3.97,
    rated_a=85.0,
    acceleration_s=9.87,
    resolution_s=0.13,
    peak_a=255.0,
    mean_a=210.5,
    i2t_a2s=437_000.0,
    i2t_error_pct=3.1,
    lowest_v=371.0,
    heating_pct=12.0,
    outliers=2,
    is_baseline=True,
    drift={"acceleration_s": QuantityChange(9.0, 11.0, 22.2)},
    samples={"t_s": (-1.0, 0.25, 0.5), "current": (0.0, 120.0, None), "thermal": (None, 20.0, None)},
)


def test_a_start_survives_json() -> None:
    data = json.loads(START.payload())

    assert json.loads(json.dumps(START.fields())) == data
    assert read_stored(StartRecord, data, starter="pump") == START
    assert data["time"] == "2026-11-21T01:02:03.456Z"
    assert data["cause"] == {"source": "command", "client": "alice", "command_id": "c1"}


@pytest.mark.parametrize(
    "wrong",
    [
        {"outcome": "exploded"},
        {"time": "yesterday"},
        {"cause": 7},
        {"peak_a": "high"},
        {"drift": {"x": {}}},
        {"samples": {"t_s": ["x"]}},
    ],
)
def test_what_is_no_record_is_an_error(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="validation error"):
        read_stored(StartRecord, {**START.fields(), **wrong}, starter="pump")
