"""A running gateway's lines, recorded and read by Wireshark's dissector."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from tests.end_to_end.plant import plant
from tests.end_to_end.site import Program
from tests.mosquitto import StartMosquitto
from tests.programs import program
from tests.tshark import dissect


async def test_a_running_gateway_is_captured_as_modbus_rtu(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    program("tshark")
    file = tmp_path / "hall.pcapng"
    async with (
        plant(start_mosquitto(), tmp_path) as (_, _, config),
        Program("gateway", "capture", str(config), str(file), "--seconds", "2") as capture,
    ):
        assert await capture.exit_code() == 0

    frames = dissect(file)
    units = Counter(frame["mbrtu"]["mbrtu.unit_id"] for frame in frames if "mbrtu" in frame)
    assert set(units) == {"1", "2", "3", "4"}
    assert all(frame["mbrtu"]["mbrtu.crc16.status"] == "1" for frame in frames)
    answered = [frame for frame in frames if "modbus.request_frame" in frame.get("modbus", {})]
    assert len(answered) > 10
    assert all(0.001 < float(frame["modbus"]["modbus.response_time"]) < 1.0 for frame in answered)
