"""A gateway that is stopped in the middle of a start, while a hand takes the starter over."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path

import pytest

from gateway.system.stalls import SUSPEND_LIMIT_S
from tests.end_to_end.plant import plant
from tests.end_to_end.site import PUMP, Scada
from tests.mosquitto import StartMosquitto
from tests.rig.sites import ALICE

STOPPED_AFTER_S = (0.0, 0.03, 0.06)  # within reading, deciding, writing and reading back


@pytest.mark.alone
async def test_no_start_is_written_on_what_was_read_before_the_process_was_stopped(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    ends = []
    site = plant(start_mosquitto(), tmp_path, starters=PUMP + ALICE, names=("pump",))
    async with site as (scada, gateway, _):
        for number, after_s in enumerate(STOPPED_AFTER_S):
            await scada.command("pump", "start", f"start-{number}")
            await asyncio.sleep(after_s)
            gateway.signal(signal.SIGSTOP)
            scada.set_knob("pump", "control", "local")
            await asyncio.sleep(SUSPEND_LIMIT_S + 0.5)
            gateway.signal(signal.SIGCONT)
            result = await final(scada, f"start-{number}")
            ends.append((result["phase"], result["code"]))
            scada.set_knob("pump", "keypad", "stop")
            scada.set_knob("pump", "control", "remote")
            await scada.until("starter/pump/state", state="ready", quality="good", remote=True)

    # Written before the stop and seen to run after it, or not at all; written in local it has no effect.
    assert {phase for phase, _ in ends} <= {"confirmed", "rejected"}, ends


async def test_the_broker_says_offline_within_16_s_for_a_gateway_that_hangs(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    site = plant(start_mosquitto(), tmp_path, starters=PUMP + ALICE, names=("pump",))
    async with site as (scada, gateway, _):
        gateway.signal(signal.SIGSTOP)
        said = await scada.until("gateway/status", state="offline", within_s=16.0)

    assert said["reason"] == "connection lost"


async def final(scada: Scada, id_: str) -> dict[str, object]:
    """Wait for the final result of a command."""
    while True:
        result = await scada.result("pump", id=id_)
        if result["phase"] not in ("accepted", "written"):
            return result
        scada.latest.pop("result/pump/alice")
