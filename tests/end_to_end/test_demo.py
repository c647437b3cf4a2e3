"""The demo as a newcomer meets it: everything by topics alone, also what a hand at the starter would do."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from tests.end_to_end.plant import STARTERS
from tests.end_to_end.site import Program, Scada
from tests.mosquitto import _find, missing_programs

pytestmark = pytest.mark.skipif(bool(missing_programs()), reason="mosquitto is not installed")


@asynccontextmanager
async def demo(environ: Mapping[str, str], on_guide: Callable[[str], None]) -> AsyncIterator[Scada]:
    """Run the demo and wait until all four starters are ready; `on_guide` gets what it has printed."""
    async with Program("gateway", "demo", environ=environ) as program:
        await program.says("others    simulator/")
        port = re.search(r"on 127\.0\.0\.1:(\d+)", program.output)
        assert port is not None
        on_guide(program.output)
        async with Scada(int(port[1]), base="starters/demo", client="demo") as scada:
            for starter in STARTERS:
                await scada.ready(starter)
            yield scada
        program.signal(signal.SIGINT)
        assert await program.exit_code() == 0


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

    async with demo(environ, guides.append) as scada:
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
        for point in ("pump/value/p220", "fan/value/p295", "mill/value/s5_4_2", "belt/value/r36"):
            await scada.until(f"starter/{point}", quality="good")
        seen = await watcher.stdout.readline()
        watcher.send_signal(signal.SIGINT)
        await watcher.communicate()

    assert seen.startswith(b"starters/demo/")
    assert "waiting for the simulated starters\n" in guides[0]
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
