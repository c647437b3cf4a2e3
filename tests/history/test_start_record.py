"""The record of a start and its JSON."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.errors import DamagedError
from gateway.plugins.history.start_record import (
    Cause,
    QuantityChange,
    StartOutcome,
    StartSamples,
    StartSource,
    StartSummary,
    start_to_dict,
)

SUMMARY = StartSummary(
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
)
CURVE = StartSamples((-1.0, 0.25, 0.5), {"current": (0.0, 120.0, None), "thermal": (None, 20.0, None)})


def test_a_start_survives_json() -> None:
    data = json.loads(json.dumps(start_to_dict(SUMMARY, CURVE)))

    assert StartSummary.from_dict(data) == SUMMARY
    assert StartSamples.from_dict(data["samples"]) == CURVE
    assert data["time"] == "2026-11-21T01:02:03.456Z"
    assert data["cause"] == {"source": "command", "client": "alice", "command_id": "c1"}


@pytest.mark.parametrize(
    "wrong",
    [{"outcome": "exploded"}, {"time": "yesterday"}, {"cause": 7}, {"peak_a": "high"}, {"drift": {"x": {}}}],
)
def test_what_is_no_record_is_an_error(wrong: dict[str, Any]) -> None:
    with pytest.raises(DamagedError, match="no record of a start"):
        StartSummary.from_dict({**SUMMARY.to_dict(), **wrong})


@pytest.mark.parametrize("wrong", [{}, {"t_s": ["x"]}, {"t_s": [1.0], "current": [1.0, 2.0]}, {"t_s": 5}])
def test_what_are_no_samples_is_an_error(wrong: dict[str, Any]) -> None:
    with pytest.raises(DamagedError, match="no samples of a start"):
        StartSamples.from_dict(wrong)
