"""scan, parameters and doctor as processes, against simulated starters on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

from gateway.config.load import parse
from tests.end_to_end.site import Program, site_config, write_config
from tests.mosquitto import StartMosquitto


async def output_of(*arguments: str) -> tuple[int, str]:
    """Run a command to its end and return its exit code and what it printed on stdout."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "gateway",
        *arguments,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    async with asyncio.timeout(60.0):
        out, _ = await process.communicate()
    return process.returncode or 0, out.decode()


async def test_starters_are_found_saved_restored_and_examined(
    tmp_path: Path, start_mosquitto: StartMosquitto
) -> None:
    port = str(tmp_path / "line")
    config = write_config(tmp_path, site_config(broker_port=start_mosquitto().port, port=port))
    saved = tmp_path / "pump.toml"
    async with Program("gateway", "simulate", str(config)) as simulator:
        await simulator.says("line hall:")

        code, text = await output_of("scan", port, "--baud", "19200", "--framing", "8N2", "--address", "1-8")
        assert code == 0, text
        found = {each.address: each.family for each in parse(text, "scan").lines[0].starters}
        assert found == {1: "ssw07", 2: "ssw06", 3: "ssw900", 4: "sst"}

        code, text = await output_of("parameters", "save", str(config), "pump", str(saved))
        assert code == 0, text
        lines = saved.read_text("utf-8").splitlines()
        changed = ["P314 = 30" if line.startswith("P314 =") else line for line in lines]
        saved.write_text("\n".join(changed), "utf-8")
        code, text = await output_of("parameters", "restore", str(config), "pump", str(saved))
        assert (code, text.splitlines()[-1]) == (0, "written and read back: P314")

        _, text = await output_of("doctor", str(config))
        assert "starter pump: is SSW-07" in text
        assert "after 30 s without a request it shows E28" in text

        async with Program("gateway", "run", str(config)) as gateway:
            await gateway.says("belt answers")
            _, text = await output_of("doctor", str(config), "--client", "alice")
            assert "the gateway is asked over MQTT" in text
            assert text.count("answers the gateway") == 4
            assert "after 30 s without a request it shows E28" in text
            assert (await output_of("parameters", "save", str(config), "pump", "-"))[0] == 1
            assert (await output_of("scan", port))[0] == 1
            gateway.signal(signal.SIGTERM)
            assert await gateway.exit_code() == 0
