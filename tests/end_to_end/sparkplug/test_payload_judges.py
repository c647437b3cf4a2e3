"""Two decoders that share no code with ours read what the node writes."""

from __future__ import annotations

from typing import Any

from gateway.plugins.sparkplug.payload import DataType, Metric, encoded
from tests.end_to_end.sparkplug.judges import (
    decoded_by_npm,
    npm_judge,
    python_judges,
    written_again_by_tahu,
)
from tests.sparkplug.plant import said
from tests.sparkplug.support import EPOCH_S

KINDS = [
    Metric("Node Control/Rebirth", DataType.BOOLEAN, False, EPOCH_S),
    Metric("true", DataType.BOOLEAN, True, EPOCH_S),
    Metric("negative", DataType.INT64, -5, EPOCH_S),
    Metric("large", DataType.INT64, 2**52, EPOCH_S),
    Metric("int32", DataType.INT32, -7, EPOCH_S),
    Metric("double", DataType.DOUBLE, -0.1, EPOCH_S),
    Metric("text", DataType.STRING, "тест °C", EPOCH_S),
    Metric("empty", DataType.STRING, "", EPOCH_S),
    Metric("null", DataType.DOUBLE, None, EPOCH_S, 0),
    Metric("stale", DataType.DOUBLE, 1.5, EPOCH_S, 500, (("engUnit", "A"),)),
    Metric("zero", DataType.INT64, 0, EPOCH_S, 192),
]


@npm_judge
def test_sparkplug_payload_of_npm_reads_every_kind_of_metric() -> None:
    (payload,) = decoded_by_npm([encoded(KINDS, time_s=EPOCH_S, seq=3)])

    metrics = {each["name"]: each for each in payload["metrics"]}
    written = {each.name: each.value for each in KINDS}
    assert {name: each["value"] for name, each in metrics.items()} == written
    assert metrics["int32"]["type"] == "Int32"
    assert metrics["stale"]["properties"]["Quality"] == {"type": "Int32", "value": 500}
    assert metrics["stale"]["properties"]["engUnit"] == {"type": "String", "value": "A"}
    assert (payload["seq"], payload["timestamp"]) == (3, EPOCH_S * 1000)


@npm_judge
def test_sparkplug_payload_of_npm_reads_every_kind_of_message() -> None:
    ours_said = said(has_datatypes=True)  # which its decoder needs

    theirs_said = decoded_by_npm([each.payload for each in ours_said])
    for ours, theirs in zip(ours_said, theirs_said, strict=True):
        metrics: dict[str, Any] = {each["name"]: each for each in theirs["metrics"]}
        assert {name: each["value"] for name, each in metrics.items()} == ours.values
        assert theirs.get("seq") == ours.seq


@python_judges
def test_tahus_own_module_writes_the_same_bytes() -> None:
    payloads = [each.payload for each in said(has_datatypes=True)] + [encoded(KINDS, time_s=EPOCH_S, seq=0)]

    assert written_again_by_tahu(payloads) == payloads
