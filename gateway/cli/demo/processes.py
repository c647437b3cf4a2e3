"""The demo's broker and simulated starters, each a process."""

from __future__ import annotations

import asyncio
import importlib.util
import itertools
import os
import shutil
import socket
import sys
import uuid
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from gateway.errors import BrokerError, PortError
from gateway.mqtt import BrokerSettings, Version

PORT = 1883
_LOOKS, _LOOK_S = 200, 0.1  # for what a process makes as it starts


class DemoBroker(NamedTuple):
    """A broker that runs, and which version of MQTT the demo's configuration states for it."""

    port: int
    title: str
    version: str


@asynccontextmanager
async def demo_broker(folder: Path) -> AsyncIterator[DemoBroker]:
    """Run a broker that any program on this machine may use; BrokerError when none can be had."""
    port = free_port(PORT)
    broker, command = _broker_command(folder, port)
    with (folder / "broker.log").open("wb") as log:
        async with _process(*command, stdin=DEVNULL, stdout=log, stderr=log) as process:
            if not await _has_begun(process, lambda: _listens(port)):
                log_text = (folder / "broker.log").read_text(errors="replace").strip()
                raise BrokerError(f"the demo's broker does not start: {log_text[-200:] or 'no message'}")
            yield broker


@asynccontextmanager
async def demo_simulator(config: Path, *, port: Path, broker_port: int) -> AsyncIterator[None]:
    """Run the simulated starters of a configuration on its port, their knobs at a broker on loopback.

    PortError when the line does not come. They end with their stdin, so also when this process is killed.
    """
    knobs = ("--knobs", f"mqtt://127.0.0.1:{broker_port}")
    command = (sys.executable, "-m", "gateway", "simulate", str(config), *knobs, "--companion")
    async with _process(*command, stdin=PIPE, stdout=DEVNULL) as process:
        if not await _has_begun(process, port.exists):
            raise PortError("of the demo", "the simulated starters do not start", "see their output above")
        yield


def _broker_command(folder: Path, port: int) -> tuple[DemoBroker, list[str]]:
    """Return the broker that is here, and how it is started; amqtt never answers a CONNECT of MQTT 5."""
    mosquitto = find_mosquitto()
    if mosquitto is not None:
        config = folder / "mosquitto.conf"
        config.write_text(
            f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\nset_tcp_nodelay true\n"
        )
        return DemoBroker(port, "Mosquitto", "auto"), [mosquitto, "-c", str(config)]
    if importlib.util.find_spec("amqtt") is None:
        raise BrokerError(
            "no broker: neither Mosquitto nor amqtt is installed",
            "apt install mosquitto, or pip install 'starter-gateway[demo]'",
        )
    config = folder / "amqtt.yaml"
    config.write_text(
        f"listeners:\n  default:\n    type: tcp\n    bind: 127.0.0.1:{port}\n"
        "plugins:\n  amqtt.plugins.authentication.AnonymousAuthPlugin:\n    allow_anonymous: true\n"
    )
    command = [sys.executable, "-m", "amqtt.scripts.broker_script", "-c", str(config)]
    return DemoBroker(port, "amqtt (embedded, MQTT 3.1.1 only)", Version.V311), command


def find_mosquitto() -> str | None:
    """Return the path of the Mosquitto broker, which Debian keeps outside an ordinary user's PATH."""
    folders = [each for bin_ in os.get_exec_path() for each in (bin_, str(Path(bin_).with_name("sbin")))]
    return shutil.which("mosquitto", path=os.pathsep.join(folders))


def free_port(wanted: int) -> int:
    """Return this port of loopback, or any free one when it is taken; BrokerError for none."""
    for port in (wanted, 0):
        with socket.socket() as probe, suppress(OSError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a demo that has just ended
            probe.bind(("127.0.0.1", port))
            return int(probe.getsockname()[1])
    raise BrokerError("no free port on loopback")


@asynccontextmanager
async def waited_for(what: str) -> AsyncIterator[None]:
    """Say on stderr what is waited for: at once, and each second."""

    async def say() -> None:
        for second in itertools.count():
            print(f"waiting for {what}" + (f", {second} s" if second else ""), file=sys.stderr, flush=True)
            await asyncio.sleep(1.0)

    saying = asyncio.create_task(say())
    try:
        yield
    finally:
        saying.cancel()


def _listens(port: int) -> bool:
    """Return whether a program on this machine takes connections there."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


async def _has_begun(process: Process, is_there: Callable[[], bool]) -> bool:
    """Return whether what a process makes is there, in time and before the process ends."""
    for _ in range(_LOOKS):
        if process.returncode is not None or is_there():
            break
        await asyncio.sleep(_LOOK_S)
    return process.returncode is None and is_there()


@asynccontextmanager
async def _process(*command: str, **streams: Any) -> AsyncIterator[Process]:
    """Run a program that Ctrl-C does not reach, and end it."""
    process = await asyncio.create_subprocess_exec(*command, **streams, start_new_session=True)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        try:
            await asyncio.wait_for(process.wait(), 5.0)
        except TimeoutError:
            process.kill()
            await process.wait()


def demo_client(port: int) -> BrokerSettings:
    """Return the way to a demo's broker by MQTT 3.1.1, which each of its brokers takes."""
    client_id = f"starter-gateway-demo-{uuid.uuid4().hex[:8]}"
    return BrokerSettings("127.0.0.1", port, client_id, version=Version.V311)
