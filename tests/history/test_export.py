import csv
import io
from typing import Any

import comtrade
import pytest

from gateway.plugins.history.export import Recording, recording_of, to_comtrade, to_csv

TRIP: dict[str, Any] = {
    "id": "b1-7",
    "time": "2026-11-21T01:02:03.456Z",
    "readings": {
        "t_s": [-60.0, -10.25, 0.0, 2.5],
        "points": {
            "current": [12.3, 980.4, None, 0.0],
            "fault": [False, None, True, True],
            "starts_total": [65534, 65535, None, 65535],
        },
        "constant": {"line_frequency": 59.9, "power_present": True},
    },
}
START: dict[str, Any] = {
    "id": "b1-9",
    "time": "2026-11-21T01:02:03.456Z",
    "samples": {"t_s": [-1.0, 0.0, 0.1], "current": [0.0, 412.5, 410.0], "power_factor": [None, 0.31, 0.33]},
}


def read(recording: Recording) -> comtrade.Comtrade:
    cfg, dat = to_comtrade(recording)
    reader = comtrade.Comtrade(use_double_precision=True)
    reader.read(cfg, dat)
    return reader


def test_another_reader_finds_the_readings_of_a_trip_in_its_comtrade() -> None:
    reader = read(recording_of("pump-1", TRIP, units={"current": "A"}))

    assert reader.cfg.rev_year == "2013"
    assert (reader.station_name, reader.rec_dev_id) == ("pump-1", "trip b1-7")
    assert reader.analog_channel_ids == ["current", "line_frequency", "starts_total"]
    assert reader.status_channel_ids == ["fault", "power_present"]
    assert reader.cfg.analog_channels[0].uu == "A"
    assert list(reader.analog[0]) == pytest.approx([12.3, 980.4, 980.4, 0.0])
    assert list(reader.analog[2]) == [65534, 65535, 65535, 65535]
    assert [list(each) for each in reader.status] == [[0, 0, 1, 1], [1, 1, 1, 1]]


def test_another_reader_finds_uneven_moments_and_the_trip_among_them() -> None:
    reader = read(recording_of("pump-1", TRIP, units={}))

    assert list(reader.time) == pytest.approx([0.0, 49.75, 60.0, 62.5])
    assert reader.trigger_timestamp.isoformat() == "2026-11-21T01:02:03.456000"
    assert reader.start_timestamp.isoformat() == "2026-11-21T01:01:03.456000"
    assert reader.trigger_time == 60.0
    assert reader.frequency == 60.0


@pytest.mark.parametrize("most", [0.0, 0.001, 99.998, 99.999, 123456.0, 9.9e9, -250.0])
def test_no_sample_is_beyond_what_ascii_carries(most: float) -> None:
    data = {"id": "x", "time": None, "samples": {"t_s": [0.0, 1.0], "current": [most, most / 3]}}

    recording = recording_of("pump-1", data, units={})
    reader = read(recording)

    _, dat = to_comtrade(recording)
    assert all(abs(int(line.split(",")[2])) <= 99998 for line in dat.split())
    assert list(reader.analog[0]) == pytest.approx([most, most / 3], rel=1e-3, abs=0.0006)


def test_csv_has_a_column_for_each_channel_and_a_row_for_each_moment() -> None:
    rows = list(csv.reader(io.StringIO(to_csv(recording_of("pump-1", TRIP, units={"current": "A"})))))

    assert rows[0] == [
        "t_s",
        "time",
        "current [A]",
        "fault",
        "line_frequency",
        "power_present",
        "starts_total",
    ]
    assert rows[2] == ["-10.25", "2026-11-21T01:01:53.206Z", "980.4", "", "59.9", "1", "65535"]
    assert rows[3] == ["0.0", "2026-11-21T01:02:03.456Z", "", "1", "59.9", "1", ""]


@pytest.mark.parametrize("data", [{"readings": {"t_s": [], "points": {}}}, {"samples": {"t_s": [0.0]}}, {}])
def test_a_record_without_readings_is_refused_with_the_reason(data: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="holds no readings"):
        recording_of("pump-1", {"id": "b1-9", "time": None, **data}, units={})
