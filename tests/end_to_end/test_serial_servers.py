"""Lines behind a serial server, as docs/recipes.md has them: clear, packing, with gaps, of Modbus TCP."""

from __future__ import annotations

import asyncio
import os
import tty
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from pymodbus.framer import FramerType
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from tests.end_to_end.site import Program, Scada, write_config
from tests.mosquitto import MosquittoBroker, StartMosquitto, free_port
from tests.rig.sites import line, starter, table

PACKING_S = 0.05
GAP_S = 0.02

Send = Callable[[asyncio.StreamWriter, "asyncio.Queue[bytes]"], Awaitable[None]]


async def at_once(writer: asyncio.StreamWriter, wire: asyncio.Queue[bytes]) -> None:
    while True:
        writer.write(await wire.get())


async def packed(writer: asyncio.StreamWriter, wire: asyncio.Queue[bytes]) -> None:
    """Collect what comes until the line has been silent for a while."""
    while True:
        data = await wire.get()
        try:
            while True:
                data += await asyncio.wait_for(wire.get(), PACKING_S)
        except TimeoutError:
            writer.write(data)


async def with_gaps(writer: asyncio.StreamWriter, wire: asyncio.Queue[bytes]) -> None:
    """Send in pieces with silences that would end a frame on a line (3.5 characters: 2 ms)."""
    while True:
        data = await wire.get()
        for begin in range(0, len(data), 3):
            writer.write(data[begin : begin + 3])
            await asyncio.sleep(GAP_S)


def lines(broker: MosquittoBroker, ports: Mapping[str, str], **allowances_s: float) -> str:
    """Return a site with a line of one starter at each port."""
    site = table("gateway", name="plant", state_dir="state") + table("mqtt", url=broker.url)
    for name, port in ports.items():
        site += line(name, port=port, adapter_allowance_s=allowances_s.get(name, 0.3))
        site += starter(f"{name}-1", 1, "ssw07", every_s=0.2)
    return site


@asynccontextmanager
async def box(device: Path, send: Send) -> AsyncIterator[str]:
    """Serve one device of a simulator to one TCP client at a time; give the URL."""
    wire: asyncio.Queue[bytes] = asyncio.Queue()
    fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(fd)
    loop = asyncio.get_running_loop()
    loop.add_reader(fd, lambda: wire.put_nowait(os.read(fd, 4096)))

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        sending = asyncio.ensure_future(send(writer, wire))
        try:
            while data := await reader.read(4096):
                os.write(fd, data)
        except ConnectionError:
            pass
        finally:
            sending.cancel()
            writer.close()

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    try:
        yield f"socket://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    finally:
        loop.remove_reader(fd)
        os.close(fd)
        server.close()


@asynccontextmanager
async def modbus_tcp_server() -> AsyncIterator[str]:
    """Run another project's server of Modbus TCP; give the URL of a serial server there."""
    port = free_port()
    zeros = SimDevice(1, [SimData(0, values=0, count=6000, datatype=DataType.REGISTERS)])
    server = ModbusTcpServer(zeros, framer=FramerType.SOCKET, address=("127.0.0.1", port))
    await server.serve_forever(background=True)
    try:
        yield f"socket://127.0.0.1:{port}"
    finally:
        await server.shutdown()


async def test_a_box_that_packs_or_leaves_gaps_costs_time_and_one_of_modbus_tcp_is_silent(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    ways: dict[str, Send] = {"clear": at_once, "packed": packed, "unsaid": packed, "gaps": with_gaps}
    (tmp_path / "simulated").mkdir()
    devices = {name: tmp_path / name for name in ways}
    ports = {name: str(device) for name, device in devices.items()}
    simulated = write_config(tmp_path / "simulated", lines(broker, ports))
    async with AsyncExitStack() as stack:
        simulator = await stack.enter_async_context(Program("gateway", "simulate", str(simulated)))
        for name in ways:
            await simulator.says(f"line {name}")
        urls = {
            name: await stack.enter_async_context(box(devices[name], send)) for name, send in ways.items()
        }
        urls["wrong"] = await stack.enter_async_context(modbus_tcp_server())
        # The gateway is not informed of what the box `unsaid` adds.
        config = write_config(tmp_path, lines(broker, urls, unsaid=0.0))
        scada = await stack.enter_async_context(Scada(broker.port))
        await stack.enter_async_context(Program("gateway", "run", str(config)))
        for name in ("clear", "packed", "gaps"):
            await scada.ready(f"{name}-1")
        for name in ("unsaid", "wrong"):
            await scada.until(f"starter/{name}-1/availability", state="offline")
        for name in urls:
            scada.latest.pop(f"gateway/line/{name}", None)
        found = {name: await scada.until(f"gateway/line/{name}", within_s=40.0) for name in urls}
        while not found["unsaid"]["stray_bytes"]:  # answers that come when they are not waited for any more
            scada.latest.pop("gateway/line/unsaid", None)
            found["unsaid"] = await scada.until("gateway/line/unsaid", within_s=40.0)

    answered = {name for name, line in found.items() if line["answered"]}
    assert answered == {"clear", "packed", "gaps"}
    assert found["packed"]["units"]["1"]["response_time_s"]["p50"] > PACKING_S
