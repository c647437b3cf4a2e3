from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.mqtt.contract.payloads import ValueTexts
from gateway.mqtt.contract.strict_json import to_json
from gateway.mqtt.contract.topics import Topics
from gateway.records import Quality, ValueRecord


def record(value: Any, *, label: str | None = None, time_s: float | None = 1_763_687_045.5) -> ValueRecord:
    return ValueRecord(
        starter="pump-1",
        point="S1.2.1",
        value=value,
        unit="°C",
        quality=Quality.GOOD,
        time_s=time_s,
        seq=7,
        label=label,
    )


@pytest.mark.parametrize("value", [12.0, 5e-324, 1e22, True, None, 3, 'a"b\\c\n\ud800', float("nan")])
@pytest.mark.parametrize("label", [None, 'Sóft "start"'])
@pytest.mark.parametrize("time_s", [1_763_687_045.5, None])
def test_what_is_put_together_by_hand_is_what_the_writer_of_all_else_would_say(
    value: Any, label: str | None, time_s: float | None
) -> None:
    said = ValueTexts(Topics("b")).of(record(value, label=label, time_s=time_s))

    time = "2025-11-21T01:04:05.500Z" if time_s else None
    fields = {"value": value, "unit": "°C", "quality": "good", "time": time, "seq": 7}
    item = {"point": "s1_2_1", "value": value, "quality": "good", "time": time, "seq": 7}
    assert said.text == to_json(fields | ({} if label is None else {"label": label}))
    assert said.item == to_json(item)
    json.loads(said.text)
    json.loads(said.item)


def test_the_topics_are_those_of_the_contract_each_time() -> None:
    texts = ValueTexts(Topics("b"))

    for _ in range(2):
        said = texts.of(record(1.0))
        assert said.topic == "b/starter/pump-1/value/s1_2_1"
        assert said.history_topic == "b/starter/pump-1/history"
