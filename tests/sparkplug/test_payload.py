"""Payloads as bytes: types, properties, and what a host may send."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.plugins.sparkplug.payload import DataType, Metric, decoded_command, encoded
from tests.rig.sparkplug import metrics_of
from tests.sparkplug.support import EPOCH_S, dcmd, write


@pytest.mark.parametrize(
    ("datatype", "number", "value", "field"),
    [
        (DataType.INT32, 3, -7, "50 f9ffffff0f"),
        (DataType.INT64, 4, -7, "58 f9ffffffffffffffff01"),
        (DataType.DOUBLE, 10, 0.1, "69 9a9999999999b93f"),
        (DataType.BOOLEAN, 11, False, "70 00"),
        (DataType.STRING, 12, "°C", "7a 03 c2b043"),
        (DataType.DOUBLE, 10, None, "38 01"),
    ],
)
def test_each_type_has_its_number_and_its_field(
    datatype: DataType, number: int, value: bool | int | float | str | None, field: str
) -> None:
    payload = encoded([Metric("x", datatype, value)], time_s=EPOCH_S, seq=0)

    (metric,) = metrics_of(payload)
    assert (metric.kind, metric.is_null, metric.time_ms) == (number, value is None, EPOCH_S * 1000)
    assert bytes.fromhex(field) in payload


def test_the_bytes_are_those_of_the_field_numbers() -> None:
    metric = Metric("a", DataType.DOUBLE, 1.0, 1.0, 500)

    payload = encoded([metric], time_s=2.0, seq=5)

    properties = "0a 07 5175616c697479" + "12 05 08 03 18 f4 03"
    body = "0a 01 61" + "18 e8 07" + "20 0a" + "4a 10" + properties + "69 000000000000f03f"
    expected = "08 d0 0f" + "12 23" + body + "18 05"
    assert payload == bytes.fromhex(expected)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_command_or_no_payload_and_nothing_raises(payload: bytes) -> None:
    command = decoded_command(payload)

    assert command is None or (
        len(command.writes(20, first="Command/Stop")) == min(len(command.metrics), 20)
        and not command.is_asking("Command/Stop")
    )


def test_what_is_broken_off_within_a_metric_is_no_payload() -> None:
    before, stop = dcmd({"name": "other"}, time_s=None), dcmd(write("Command/Stop"), time_s=None)

    assert [decoded_command(before + stop[:size]) for size in range(1, len(stop))] == [None] * (len(stop) - 1)
    whole = decoded_command(before + stop)
    assert whole is not None
    assert whole.is_asking("Command/Stop")


@pytest.mark.parametrize(
    "payload",
    [b"\xff\xff", b"\x0a", b'{"value": true}', b"\x12\x7f", b"\x13" * 50, b"\x12\x02\x0a", b"\xff" * 20],
)
def test_what_is_no_payload_asks_nothing(payload: bytes) -> None:
    assert decoded_command(payload) is None


def test_a_name_that_is_no_utf_8_is_a_name_that_is_not_known() -> None:
    bad = b"\x12\x08" + b"\x0a\x04\xff\xfeab" + b"\x70\x01"
    command = decoded_command(bad + dcmd(write("b"), time_s=None))
    assert command is not None
    (first, second) = command.writes(20, first="")

    assert (first.name, first.is_true, second.name) == ("\ufffd\ufffdab", True, "b")
