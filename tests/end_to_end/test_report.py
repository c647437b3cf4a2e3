"""The health report beside a real gateway and a real broker."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from tests.end_to_end.plant import plant
from tests.end_to_end.site import Program
from tests.mosquitto import StartMosquitto, missing_programs

pytestmark = pytest.mark.skipif(bool(missing_programs()), reason="mosquitto is not installed")


@pytest.mark.long
async def test_the_report_of_a_running_gateway_has_a_start_and_the_lines_quality(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    page = tmp_path / "pump.html"
    async with plant(broker, tmp_path) as (scada, gateway, config):
        await scada.command("pump", "start", "one")
        await scada.until("starter/pump/start", within_s=60.0, outcome="full_voltage")
        async with Program("gateway", "report", str(config), "pump") as report:
            assert await report.exit_code() == 0
        async with Program("gateway", "report", str(config), "pump", "--html", str(page)) as written:
            assert await written.exit_code() == 0
        gateway.signal(signal.SIGTERM)
        assert await gateway.exit_code() == 0

    for expected in ("Health report: pump", "alice", "Line hall", "asked", "answered"):
        assert expected in report.output
    assert "left out" not in report.output
    assert "<svg" in page.read_text("utf-8")
