import random
from typing import Any

import pytest

from gateway.contract import EventRecord, ReadingTable, Severity, TripRecord
from gateway.plugins.history.trip_recorder import AFTER_S, MOST_BYTES, NOTHING, TripRecorder, fitted

TIME_S = 1_795_222_923.456


def fault(recorder: TripRecorder, now_s: float, *, seq: int = 7) -> TripRecord | None:
    event = EventRecord(
        starter="pump",
        seq=seq,
        time_s=TIME_S,
        boot="boot",
        code="fault",
        severity=Severity.ERROR,
        text="fault, was running",
        data={"from": "running"},
    )
    return recorder.note_fault(event, now_s=now_s)


def trip(text: str, readings: ReadingTable, at_fault: dict[str, Any]) -> TripRecord:
    return TripRecord(
        starter="pump",
        id="b-1",
        time_s=TIME_S,
        boot="b",
        seq=1,
        code="f005",
        text=text,
        state_before="running",
        readings=readings,
        at_fault=at_fault,
        fault_history=(),
    )


def test_a_number_that_is_read_after_the_fault_is_the_records() -> None:
    recorder = TripRecorder()
    recorder.note_alarm("fault", "Fault", is_active=True)
    fault(recorder, now_s=10.0)
    recorder.add_fault_data({}, [])
    assert recorder.take_due(10.0 + AFTER_S) is None

    recorder.note_alarm("f005", "Motor overload", is_active=True)
    trip = recorder.take_due(10.0 + AFTER_S)

    assert trip is not None
    assert (trip.code, trip.text) == ("f005", "Motor overload")


def test_a_fault_that_was_cleared_does_not_name_the_next_trip() -> None:
    recorder = TripRecorder()
    recorder.note_alarm("e05", "Motor overload", is_active=True)
    recorder.note_alarm("e05", "Motor overload", is_active=False)
    recorder.note_alarm("e24", "Programming error", is_active=True)
    fault(recorder, now_s=10.0)
    recorder.add_fault_data({}, [])

    trip = recorder.take_due(20.0)

    assert trip is not None
    assert trip.code == "e24"


def large(points: int, rows: int, seed: int = 1) -> TripRecord:
    chance = random.Random(seed)
    t_s = tuple(round(-60 + 62 * row / rows, 3) for row in range(rows))
    columns = {f"point_{n}": tuple(round(chance.uniform(0, 999), 1) for _ in t_s) for n in range(points)}
    rows_at_fault = {f"D{n}": {"value": n, "unit": "A", "name": "x" * 40} for n in range(20)}
    return trip("Motor overload", ReadingTable(t_s, columns, {}), rows_at_fault)


@pytest.mark.parametrize(("points", "rows"), [(3, 60), (12, 240), (40, 1000)])
def test_a_record_has_at_most_16_kilobytes_and_still_the_10_seconds_before(points: int, rows: int) -> None:
    found = fitted(large(points, rows))

    assert len(found.payload()) <= MOST_BYTES
    assert found.readings.t_s[0] <= -10.0 + 2.0
    assert len(found.at_fault) == 20
    assert bool(found.thinned) is (rows > 60)


def test_even_a_record_of_long_texts_fits() -> None:
    rows: dict[str, Any] = {f"D{n}": {"value": n, "unit": "A", "name": "é" * 400} for n in range(100)}
    assert len(fitted(trip("x" * 40_000, NOTHING, rows)).payload()) <= MOST_BYTES
