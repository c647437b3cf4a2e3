from __future__ import annotations

import json
from typing import Any

import pytest
from gateway.mqtt.contract.payloads import Payloads, late_value
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import Quality, Topics, ValueRecord, encoded

PAYLOADS = Payloads(Topics("b"), "r1")
TRICKS = [
    ',"unit":"A","quality":"bad","boot":"x"',
    '"',
    ',"',
    "\\",
    '\\"',
    ',"boot":',
    'unit":',
    '{"value":1}',
]


def record(
    value: Any, *, unit: str = "°C", label: str | None = None, time_s: float | None = 1_763_687_045.5
) -> ValueRecord:
    return ValueRecord(
        starter="pump-1",
        point="S1.2.1",
        value=value,
        unit=unit,
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
    said = PAYLOADS.message(record(value, label=label, time_s=time_s))
    late = late_value(said)

    time = "2025-11-21T01:04:05.500Z" if time_s else None
    fields = {"value": value, "unit": "°C", "quality": "good", "time": time, "seq": 7, "boot": "r1"}
    item = {"point": "s1_2_1", "value": value, "quality": "good", "time": time, "seq": 7}
    assert said.payload == encoded(fields | ({} if label is None else {"label": label}))
    assert late.item == encoded(item)
    json.loads(said.payload)
    json.loads(late.item)


@given(
    st.sampled_from(TRICKS)
    | st.text(st.sampled_from(',":\\{}unitboqaly'), max_size=30)
    | st.floats()
    | st.integers(),
    st.sampled_from(TRICKS) | st.text(max_size=8),
    st.sampled_from(TRICKS) | st.none(),
)
def test_no_text_in_a_value_is_taken_for_the_json_around_it(value: Any, unit: str, label: str | None) -> None:
    said = PAYLOADS.message(record(value, unit=unit, label=label))

    fields = json.loads(said.payload)
    wanted = {name: fields[name] for name in ("value", "quality", "time", "seq")}
    assert json.loads(late_value(said).item) == {"point": "s1_2_1", **wanted}


@pytest.mark.parametrize("value", [12.0, 1e22, True, None, 3, 'a"b\\c\n'])
@pytest.mark.parametrize("label", [None, 'Sóft "start"'])
@pytest.mark.parametrize("time_s", [1_763_687_045.5, None])
def test_a_retained_message_says_the_record_that_it_was_made_of(
    value: Any, label: str | None, time_s: float | None
) -> None:
    payloads = Payloads(Topics("b"), "r1")
    bad = ValueRecord(
        starter="pump-2",
        point="Current",
        value=None,
        unit="A",
        quality=Quality.BAD,
        time_s=time_s,
        seq=8,
        reason="another model",
    )
    records = [record(value, label=label, time_s=time_s), bad]

    latest = {message.topic: message for message in map(payloads.message, records)}

    assert list(payloads.values_in(latest)) == records
