"""`history`: lists and exports what a gateway has stored."""

from __future__ import annotations

import asyncio
import csv
import json
from pathlib import Path
from typing import Any

import comtrade
import pytest

from gateway.cli.main import main
from gateway.storage.history import HistoryStore
from tests.small_site import small_site

CONFIG = small_site(("pump", "ssw07"), ("fan", "ssw07"))
TRIP: dict[str, Any] = {
    "id": "b1-7",
    "time": "2026-11-21T01:02:03.456Z",
    "code": "e05",
    "text": "Motor overload",
    "state_before": "running",
    "readings": {
        "t_s": [-10.25, 0.0],
        "points": {"current": [980.4, 0.0], "fault": [False, True]},
        "constant": {"p050": 251},
    },
}
SUMMARY: dict[str, Any] = {
    "id": "b1-9",
    "time": "2026-11-21T02:00:00.000Z",
    "outcome": "full_voltage",
    "acceleration_s": 8.25,
    "peak_a": 412.5,
}
CURVE: dict[str, Any] = {"t_s": [-1.0, 0.0, 0.1], "current": [0.0, 412.5, 410.0]}


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A gateway whose pump has started twice and tripped once; of the first start the curve is gone."""

    async def store() -> None:
        history = HistoryStore(tmp_path / "state", on_news=lambda *_: None)
        history.start()
        rows = (
            ("start", "b1-1", SUMMARY | {"id": "b1-1"}),
            ("trip", "b1-7", TRIP),
            ("curve", "b1-9", CURVE),
            ("start", "b1-9", SUMMARY),
            ("counters", "b1", {"totals": {}}),
        )
        for kind, id_, data in rows:
            history.put("pump", kind, id_, time_s=1.0, data=data, limit=100)
        assert await history.close(10.0)

    (tmp_path / "state").mkdir()
    asyncio.run(store())
    path = tmp_path / "plant.toml"
    path.write_text(CONFIG)
    return path


def test_records_are_printed_as_they_are_stored(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["history", str(config), "pump", "--json", "--id", "b1-7"]) == 0

    assert json.loads(capsys.readouterr().out) == TRIP


def test_the_newest_trip_is_exported_as_csv(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["history", str(config), "pump", "--csv", "-"]) == 0

    rows = list(csv.reader(capsys.readouterr().out.splitlines()))
    assert rows[0] == ["t_s", "time", "current [A]", "fault", "p050 [%]"]
    assert rows[1] == ["-10.25", "2026-11-21T01:01:53.206Z", "980.4", "0", "251"]


def test_another_reader_reads_the_exported_comtrade(config: Path, tmp_path: Path) -> None:
    base = tmp_path / "trip"
    assert main(["history", str(config), "pump", "--comtrade", str(base)]) == 0

    reader = comtrade.load(f"{base}.cfg", f"{base}.dat")
    assert reader.station_name == "pump"
    assert reader.analog_channel_ids == ["current", "p050"]
    assert list(reader.analog[0]) == pytest.approx([980.4, 0.0])
    assert reader.trigger_time == pytest.approx(10.25)


def test_the_curve_of_a_start_is_exported_by_its_id(config: Path, tmp_path: Path) -> None:
    base, table = tmp_path / "start", tmp_path / "start.csv"
    arguments = ["history", str(config), "pump", "--id", "b1-9", "--comtrade", str(base), "--csv", str(table)]
    assert main(arguments) == 0

    reader = comtrade.load(f"{base}.cfg", f"{base}.dat")
    assert list(reader.analog[0]) == pytest.approx([0.0, 412.5, 410.0])
    assert table.read_bytes().count(b"\r\n") == 4


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (["valve"], 2, "no starter 'valve' (one of pump, fan)"),
        (["pump", "--id", "b9-9"], 2, "pump has no record b9-9"),
        (["pump", "--id", "b1-1", "--csv", "-"], 1, "b1-1"),  # its curve is not stored any more
        (["fan", "--csv", "-"], 1, "fan has no record"),
        (["pump", "--csv", "/no/such/folder/x.csv"], 1, "cannot be written"),
    ],
)
def test_what_cannot_be_done_is_said(
    config: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, reason: str
) -> None:
    assert main(["history", str(config), *arguments]) == code
    assert reason in capsys.readouterr().err


def test_without_a_history_the_error_says_where_it_was_looked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "plant.toml"
    path.write_text(CONFIG)

    assert main(["history", str(path), "pump"]) == 1
    assert "history.db" in capsys.readouterr().err
