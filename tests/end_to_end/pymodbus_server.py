"""A Modbus RTU server of pymodbus, run as a program: `pymodbus_server.py PORT BAUD UNIT ADDRESS=WORD..`."""

from __future__ import annotations

import asyncio
import sys

from pymodbus.framer import FramerType
from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice


async def serve(port: str, baud: int, unit: int, words: dict[int, int]) -> None:
    cells = [
        SimData(address, values=word, datatype=DataType.REGISTERS) for address, word in sorted(words.items())
    ]
    server = ModbusSerialServer(SimDevice(unit, cells), framer=FramerType.RTU, port=port, baudrate=baud)
    await server.serve_forever(background=True)
    print("serving", flush=True)
    await asyncio.Event().wait()


if __name__ == "__main__":
    path, rate, address, *cells = sys.argv[1:]
    pairs = (cell.split("=") for cell in cells)
    asyncio.run(serve(path, int(rate), int(address), {int(key, 0): int(value, 0) for key, value in pairs}))
