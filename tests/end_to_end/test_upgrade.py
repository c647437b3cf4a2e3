"""Backup and restore of a gateway that runs, with real processes."""

from __future__ import annotations

import asyncio
import json
import signal
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from gateway.storage.upkeep.versions import found_in
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.mosquitto import StartMosquitto

STARTERS = ("pump", "fan", "mill", "belt")


async def command_line(*arguments: str, within_s: float = 30.0) -> tuple[int, str]:
    """Run a command to its end; return its exit code and what it printed."""
    async with Program("gateway", *arguments) as program:
        return await program.exit_code(within_s=within_s), program.output


def issued(id_: str) -> str:
    """Return a start that proves itself fresh by its time, for the longest that is possible."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return json.dumps({"id": id_, "issued_at": now, "ttl_s": 60})


@pytest.mark.long
async def test_a_backup_of_a_running_gateway_comes_back_and_lets_no_command_of_before_act(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    text = site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL"))
    config = write_config(
        tmp_path, text.replace('state_dir = "state"', 'state_dir = "state"\nclock = "trusted"')
    )
    backup = tmp_path / "plant.tar.gz"
    async with (
        Program("gateway", "simulate", str(config)) as simulator,
        broker.watch("starters/plant/#") as watcher,
    ):
        await simulator.says("line hall")
        scada = Scada(broker, watcher)
        async with Program("gateway", "run", str(config)) as gateway:
            for starter in STARTERS:
                await scada.ready(starter)
            boot = await scada.boot()
            code, out = await command_line("backup", str(config), str(backup))
            assert code == 0, out
            await asyncio.sleep(2.1)  # after the connection: this clock might be ahead of the gateway's
            late = issued("late")
            await scada.publish("command/pump/alice/start", late)
            await scada.result("pump", id="late", phase="confirmed")
            await scada.publish("command/pump/alice/stop", "")
            await scada.until("starter/pump/state", state="ready")
            assert (await command_line("check", str(config), "--upgrade"))[0] == 0
            assert (await command_line("restore", str(backup), "--replace"))[0] == 1  # it runs
            gateway.signal(signal.SIGTERM)
            await scada.until("gateway/event", code="stopping")
            assert await gateway.exit_code() == 0
        code, out = await command_line("restore", str(backup), "--replace")
        assert code == 0, out
        assert "locked until an operator unlocks them: pump, fan, mill, belt" in out
        seen = len(scada.events)
        async with Program("gateway", "run", str(config)) as gateway:
            for starter in STARTERS:
                await scada.until(
                    f"starter/{starter}/state", state="ready", quality="good", boot=await _other(scada, boot)
                )
            await scada.publish("command/pump/alice/start", late)
            old = await scada.result("pump", id="late", phase="rejected")
            await scada.command("pump", "start", "fresh")
            fresh = await scada.result("pump", id="fresh", phase="rejected")
            await scada.publish("command/pump/alice/stop", '{"id": "stop"}')
            await scada.result("pump", id="stop", phase="confirmed")
            gateway.signal(signal.SIGTERM)
            assert await gateway.exit_code() == 0

    assert old["code"] in ("before_connection", "ledger_unavailable")
    assert fresh["code"] in ("ledger_unavailable", "locked")
    assert "started" not in {event["code"] for event in scada.events[seen:]}
    assert {each.name: version for each, version in found_in(tmp_path / "state")}["gateway.sqlite"] == 1


async def _other(scada: Scada, boot: str) -> str:
    """Wait for a connection of another run, and return its name."""
    deadline_s = time.monotonic() + 20.0
    while time.monotonic() < deadline_s:
        now = await scada.until("gateway/status", state="online")
        if now["boot"] != boot:
            return str(now["boot"])
        await scada.until("gateway/fresh")
        scada.latest.pop("gateway/status")
    raise AssertionError("no other run came")
