"""The demo as a newcomer meets it: everything by topics alone, also what a hand at the starter would do."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.sim.core.start_curve import start_curve
from gateway.sim.factory import make_unit
from tests.end_to_end.demo_site import demo
from tests.end_to_end.site import Scada
from tests.mosquitto import StartMosquitto, _find, missing_programs

pytestmark = pytest.mark.skipif(bool(missing_programs()), reason="mosquitto is not installed")

WITHIN = 0.03

# What each family's starter trips with, the alarm's topic, and how it is configured.
STARTERS: dict[str, tuple[str, str, str, dict[str, Any]]] = {
    "pump": ("E05", "e05", "set", {"parameter": "P314", "value": 30}),
    "fan": ("E05", "fault", "set", {"parameter": "P313", "value": "General disable"}),
    "mill": ("F005", "f005", "set", {"parameter": "C8.2.5.3", "value": 12.5}),
    "belt": ("COIL17", "coil17", "configure", {"R33": 4.0, "R41": 30}),
}


async def by_hand(scada: Scada, starter: str, knob: str, setting: str) -> dict[str, Any]:
    """Set a knob of a simulated starter and return the answer."""
    scada.latest.pop(f"simulator/{starter}/done", None)
    await scada.set_knob(starter, knob, setting)
    return await scada.until(f"simulator/{starter}/done", knob=knob)


@pytest.mark.long
async def test_every_family_is_started_stopped_tripped_reset_and_configured_by_topics_alone(
    tmp_path: Path,
) -> None:
    async with demo(tmp_path) as scada:
        for starter in STARTERS:
            await scada.command(starter, "start", f"{starter}-1")
        for starter in STARTERS:
            await scada.result(starter, id=f"{starter}-1", phase="confirmed")
        for starter in STARTERS:
            await scada.command(starter, "stop", f"{starter}-2")
        for starter in STARTERS:
            await scada.result(starter, id=f"{starter}-2", phase="confirmed")
            await scada.until(f"starter/{starter}/state", state="ready", quality="good")
        for starter in STARTERS:
            await scada.command(starter, "start", f"{starter}-3")
            await scada.result(starter, id=f"{starter}-3", phase="confirmed")
        for starter, (code, alarm, _, _) in STARTERS.items():
            assert (await by_hand(scada, starter, "trip", code))["text"] == f"tripped: {code}"
            await scada.until(f"starter/{starter}/state", state="fault", quality="good")
            await scada.until(f"starter/{starter}/alarm/{alarm}", active=True, severity="fault")
        for starter in STARTERS:
            await scada.command(starter, "reset", f"{starter}-4")
        for starter, (_, alarm, _, _) in STARTERS.items():
            await scada.result(starter, id=f"{starter}-4", phase="confirmed")
            await scada.until(f"starter/{starter}/alarm/{alarm}", active=False)
            await scada.until(f"starter/{starter}/state", state="ready", quality="good")
        for starter, (_, _, verb, args) in STARTERS.items():
            await scada.command(starter, verb, f"{starter}-5", **args)
            await scada.result(starter, id=f"{starter}-5", phase="confirmed")

    assert all(scada.phases(f"{starter}-1") == ["accepted", "written", "confirmed"] for starter in STARTERS)


@pytest.mark.alone
async def test_the_record_of_a_start_agrees_with_the_motor_of_the_demo_within_three_percent(
    tmp_path: Path,
) -> None:
    motor = make_unit("ssw07", 1).motor.data
    true = start_curve(motor)
    async with demo(tmp_path) as scada:
        await scada.command("pump", "start", "c1")
        record = await scada.until("starter/pump/start", within_s=60.0)
        await scada.command("pump", "stop", "c2")
        await scada.result("pump", id="c2", phase="confirmed")

    # A machine that is busy reads less often, and then the record itself says that it is less exact.
    time_within = max(WITHIN, record["resolution_s"] / true.duration_s)
    i2t_within = max(WITHIN, record["i2t_error_pct"] / 100)
    assert (record["outcome"], record["cause"]["command_id"]) == ("full_voltage", "c1")
    assert record["acceleration_s"] == pytest.approx(true.duration_s, rel=time_within)
    assert record["peak_a"] == pytest.approx(true.peak_a, rel=WITHIN)
    assert record["i2t_a2s"] == pytest.approx(true.i2t_a2s, rel=i2t_within)
    assert record["resolution_s"] < 0.1 * true.duration_s, "so much is certain even then"


async def test_a_hand_at_the_starter_takes_control_and_power_away_and_gives_them_back(tmp_path: Path) -> None:
    async with demo(tmp_path) as scada:
        await by_hand(scada, "pump", "control", "local")
        await scada.until("starter/pump/state", remote=False)
        await scada.command("pump", "start", "held")
        held = await scada.result("pump", id="held", phase="rejected")
        await by_hand(scada, "mill", "power", "off")
        await scada.until("starter/mill/availability", state="offline")
        await by_hand(scada, "mill", "power", "on")
        await scada.until("starter/mill/state", state="ready", quality="good")
        refused = await by_hand(scada, "pump", "trip", "often")

    assert held["code"] == "in_local"
    assert "no number 'often'" in refused["error"]


@pytest.mark.parametrize("has_mosquitto", [True, False], ids=["Mosquitto", "the embedded broker"])
async def test_every_command_of_the_guide_works_when_it_is_pasted(
    tmp_path: Path, *, has_mosquitto: bool
) -> None:
    tools = tmp_path / "tools"
    tools.mkdir()
    mosquitto = ("mosquitto", "mosquitto_sub", "mosquitto_pub") if has_mosquitto else ()
    for name in ("cut", "cat", *mosquitto):
        (tools / name).symlink_to(_find(name) or name)
    environ = {"PATH": str(tools)}
    guides: list[str] = []

    async with demo(tmp_path, environ=environ, on_guide=guides.append) as scada:
        guide = guides[0].split("Paste these into another terminal:")[1]
        watching, *rest = [part.strip() for part in re.split(r"(?m)^#.*$", guide)[1:]]
        watcher = await pasted(watching, environ, tmp_path)
        assert watcher.stdout is not None
        for part in rest:
            commands = part.split("\n\n")[0].partition("\nothers")[0]
            process = await pasted(commands, environ, tmp_path)
            output, _ = await asyncio.wait_for(process.communicate(), 60.0)
            assert process.returncode == 0, (commands, output)
        await scada.until("starter/pump/state", state="fault", quality="good")
        seen = await watcher.stdout.readline()
        watcher.send_signal(signal.SIGINT)
        await watcher.communicate()

    assert seen.startswith(b"starters/demo/")
    assert ("mosquitto_sub" in guide) is has_mosquitto
    assert ("amqtt (embedded, MQTT 3.1.1 only)" in guides[0]) is not has_mosquitto


async def pasted(commands: str, environ: Mapping[str, str], folder: Path) -> asyncio.subprocess.Process:
    """Run lines as a terminal in another folder would, each of which must succeed."""
    return await asyncio.create_subprocess_exec(
        shutil.which("bash") or "bash",
        "-ec",
        commands if "\n" in commands else f"exec {commands}",
        cwd=folder,
        env={"HOME": os.environ.get("HOME", "/"), **environ},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )


@pytest.mark.parametrize("option", ["--watch=a#b", "--watch=", "--publish=a/#=x"])
def test_a_topic_that_mqtt_does_not_allow_is_wrong_usage(
    start_mosquitto: StartMosquitto, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    assert main(["demo", "--broker", str(start_mosquitto().port), option]) == 2
    assert option.partition("=")[0] in capsys.readouterr().err
