"""The motors' history outlives SIGKILL."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest

from gateway.history.start_record import StartSamples, StartSummary
from gateway.storage.history import read_history
from tests.end_to_end.killed_writer import write_until_killed
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.history.killed import kill_history_writer
from tests.lab.torture.of_history import GATEWAY
from tests.mosquitto import StartMosquitto

KILLS = 8
STARTED_WITHIN_S = 40.0


def test_no_start_that_was_stored_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    stored = kill_history_writer(write_until_killed, tmp_path, kills=KILLS, dice=random.Random(5))

    assert stored > 20 * KILLS


@pytest.mark.long
async def test_a_kill_of_the_gateway_loses_no_start_and_publishes_each_that_is_stored(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    assert start_mosquitto, "the site has a broker of its own"

    row = await GATEWAY.on_site(tmp_path, GATEWAY.short, seed=1)

    assert row.failures == [], str(row)


@pytest.mark.paired
async def test_a_kill_costs_the_start_under_way_and_no_other(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    config = write_config(tmp_path, site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL")))
    async with Program("gateway", "simulate", str(config)) as simulator:
        await simulator.says("line hall")
        async with Program("gateway", "run", str(config)) as gateway, broker.watch("starters/plant/#") as w:
            scada = Scada(broker, w)
            await scada.ready("belt")
            await scada.ready("pump")
            await scada.command("belt", "start", "c1")
            record = await scada.until("starter/belt/start", within_s=STARTED_WITHIN_S)
            await scada.command("pump", "start", "c2")
            await scada.result("pump", id="c2", phase="confirmed")
            gateway.signal(signal.SIGKILL)
            await gateway.exit_code()

        rows = read_history(tmp_path / "state", "belt")
        assert [row.data["id"] for row in rows if row.kind == "start"] == [record["id"]]
        (curve,) = [StartSamples.from_dict(row.data) for row in rows if row.kind == "curve"]
        assert curve.to_dict() == record["samples"]
        assert read_history(tmp_path / "state", "pump") == []

        async with Program("gateway", "run", str(config)), broker.watch("starters/plant/#") as w:
            scada = Scada(broker, w)
            await scada.until("starter/belt/state", state="running")
            await scada.command("belt", "baseline", "c3")
            result = await scada.result("belt", id="c3", phase="confirmed")
            assert result["start"] == record["id"]

    assert record["outcome"] == "full_voltage"
    assert record["cause"]["client"] == "alice"
    summary = StartSummary.from_dict(record)
    assert summary.acceleration_s is not None
    assert summary.resolution_s is not None
    # 3 % where the machine lets the gateway read in time; else what the record itself says, up to a bound.
    assert abs(summary.acceleration_s - 4.0) < max(0.03 * 4.0, summary.resolution_s)
    assert summary.resolution_s < 0.15 * 4.0
    (baseline,) = [row.data for row in read_history(tmp_path / "state", "belt") if row.kind == "baseline"]
    assert baseline["starts"] == [record["id"]]
