"""A plant of simulated starters on a pty, a real Mosquitto, and the gateway as the service it will be."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.end_to_end.plant import STARTERS, plant
from tests.mosquitto import StartMosquitto
from tests.reference.examples import blocks


@pytest.mark.long
async def test_every_family_starts_runs_and_stops_by_topics_alone(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, _, _):
        for starter in STARTERS:
            await scada.command(starter, "start", f"start-{starter}")
        for starter in STARTERS:
            await scada.until(f"starter/{starter}/state", state="running", quality="good")
        running = {starter: scada.phases(f"start-{starter}") for starter in STARTERS}
        for starter in STARTERS:
            scada.say(f"command/{starter}/alice/stop")
        for starter in STARTERS:
            await scada.result(starter, verb="stop", phase="confirmed")
            await scada.until(f"starter/{starter}/state", state="ready", quality="good")

        files = [path for path in (tmp_path / "state").rglob("*") if path.is_file()]
        assert {path.stat().st_mode & 0o077 for path in files} == {0}

    assert running == {starter: ["accepted", "written", "confirmed"] for starter in STARTERS}
    assert [event["code"] for event in scada.events].count("started") == len(STARTERS)


async def test_the_example_for_mosquitto_pub_starts_and_stops(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    (shown, *_) = blocks("clients.md", "sh")
    lines = [each for each in shown.splitlines() if "/result/" not in each]
    script = "\n".join(lines).replace("B=starters/mcc1", "B=starters/plant").replace("pump-1", "pump")
    for program in ("mosquitto_sub", "mosquitto_pub"):
        script = script.replace(f"{program} ", f"{program} -p {broker.port} ")
    async with plant(broker, tmp_path) as (scada, _, _):
        shell = await asyncio.create_subprocess_exec("sh", "-c", script)
        await scada.result("pump", verb="start", phase="accepted")
        await scada.result("pump", verb="stop", phase="confirmed")
        code = await shell.wait()

    assert code == 0
