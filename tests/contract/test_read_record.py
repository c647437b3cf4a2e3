"""A payload as a record: what is ignored, and what makes it none."""

from __future__ import annotations

import json

import pytest

from gateway.contract import Phase, ResultRecord, StartRecord, read_record, read_stored
from tests.contract.examples import START

WHOLE = (
    b'{"id":"1","verb":"read","phase":"confirmed","code":"ok","text":"","time":"2026-11-21T01:02:03.456Z",'
    b'"duplicate":true,"value":3.0,"correlation":"x","starter":"fan"}'
)


def read(payload: bytes) -> ResultRecord:
    return read_record(ResultRecord, payload, starter="pump", client="alice")


def test_own_fields_are_typed_and_all_others_stand_beside_them() -> None:
    record = read(WHOLE)

    assert (record.phase, record.is_duplicate, record.starter) == (Phase.CONFIRMED, True, "pump")
    assert (record.time_s, record.correlation) == (1795222923.456, None)
    assert record.values == {"value": 3.0, "correlation": "x", "starter": "fan"}


def test_a_time_that_is_not_known_stays_null() -> None:
    record = read(WHOLE.replace(b'"2026-11-21T01:02:03.456Z"', b"null"))

    assert b'"time":null' in record.payload()


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (b'"phase":"confirmed"', b'"phase":"finished"', "phase"),
        (b'"phase":"confirmed",', b"", "phase"),
        (b'"id":"1"', b'"id":1', "id"),
        (b'"text":""', b'"text":null', "text"),
        (b'"2026-11-21T01:02:03.456Z"', b'"yesterday"', "time"),
        (b'"2026-11-21T01:02:03.456Z"', b"1795222923.456", "must be a text"),
    ],
)
def test_anything_else_is_no_record(old: bytes, new: bytes, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        read(WHOLE.replace(old, new))


def test_a_stored_start_is_the_record_again() -> None:
    again = read_stored(StartRecord, json.loads(START.payload()), starter="pump")

    assert (again.payload(), again.cause, again.samples) == (START.payload(), START.cause, START.samples)
