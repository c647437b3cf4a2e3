"""The demo's processes: a broker, and the simulated starters, so that these answer on time."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import shutil
import socket
import sys
from pathlib import Path

from gateway.errors import BrokerError, PortError

PORT = 1883
_START_TIMEOUT_S = 20.0


class DemoBroker:
    """A broker process that lives as long as the demo; any program on this machine may use it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: asyncio.subprocess.Process | None = None
        self.port = free_port(PORT)
        self.title = ""

    async def start(self) -> None:
        """Start the broker and wait until it listens; raise BrokerError when none can be had."""
        command = self._command()
        with (self._folder / "broker.log").open("wb") as log:
            self._process = await asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
            )
        for _ in range(int(_START_TIMEOUT_S / 0.1)):
            if self._process.returncode is not None:
                break
            if await _listens(self.port):
                return
            await asyncio.sleep(0.1)
        log_text = (self._folder / "broker.log").read_text(errors="replace").strip()
        await self.stop()
        raise BrokerError(f"the demo's broker does not start: {log_text[-200:] or 'no message'}")

    async def stop(self) -> None:
        """End the broker's process."""
        process, self._process = self._process, None
        await _end(process)

    def _command(self) -> list[str]:
        mosquitto = find_mosquitto()
        if mosquitto is not None:
            self.title = "Mosquitto"
            config = self._folder / "mosquitto.conf"
            config.write_text(
                f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence false\n"
                "set_tcp_nodelay true\n"
            )
            return [mosquitto, "-c", str(config)]
        if importlib.util.find_spec("amqtt") is None:
            raise BrokerError(
                "no broker: neither Mosquitto nor amqtt is installed",
                "apt install mosquitto, or pip install 'starter-gateway[demo]'",
            )
        self.title = "amqtt (embedded, MQTT 3.1.1 only)"
        config = self._folder / "amqtt.yaml"
        config.write_text(
            "listeners:\n  default:\n    type: tcp\n"
            f"    bind: 127.0.0.1:{self.port}\n"
            "plugins:\n  amqtt.plugins.authentication.AnonymousAuthPlugin:\n    allow_anonymous: true\n"
        )
        return [sys.executable, "-m", "amqtt.scripts.broker_script", "-c", str(config)]


def find_mosquitto() -> str | None:
    """Return the path of the Mosquitto broker, which Debian keeps outside an ordinary user's PATH."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


def free_port(wanted: int) -> int:
    """Return this port of loopback, or any free one when it is taken; BrokerError for none."""
    for port in (wanted, 0):
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a demo that has just ended
            probe.bind(("127.0.0.1", port))
            return int(probe.getsockname()[1])
    raise BrokerError("no free port on loopback")


async def _listens(port: int) -> bool:
    try:
        _, writer = await asyncio.open_connection("127.0.0.1", port)
    except OSError:
        return False
    writer.close()
    with contextlib.suppress(OSError):
        await writer.wait_closed()
    return True


_READY = "knobs:"  # how the last line that it prints begins


class DemoSimulator:
    """The simulated starters of a configuration, their knobs at a broker on loopback."""

    def __init__(self, config: Path, *, broker_port: int) -> None:
        self._config = config
        self._broker = f"mqtt://127.0.0.1:{broker_port}"
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        """Start and wait until the line is there; PortError when it does not come."""
        command = ("-m", "gateway", "simulate", str(self._config), "--knobs", self._broker, "--companion")
        self._process = process = await asyncio.create_subprocess_exec(
            sys.executable,
            *command,
            stdin=asyncio.subprocess.PIPE,  # closed when we are killed, which ends it too
            stdout=asyncio.subprocess.PIPE,
            start_new_session=True,
        )
        assert process.stdout is not None
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_START_TIMEOUT_S):
                while line := await process.stdout.readline():
                    if line.decode().startswith(_READY):
                        return
        await self.stop()
        raise PortError("of the demo", "the simulated starters do not start", "see their output above")

    async def stop(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        await _end(process)


async def _end(process: asyncio.subprocess.Process | None) -> None:
    if process is None:
        return
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.wait(), 5.0)
    except TimeoutError:
        process.kill()
        await process.wait()
