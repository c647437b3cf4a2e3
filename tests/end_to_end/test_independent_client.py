"""The words of the four manuals, asked of simulated starters by a client that shares no code with them."""

from __future__ import annotations

import ast
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.end_to_end import independent_client
from tests.end_to_end.independent_client import Client, ModbusExceptionError
from tests.rig.sites import line, starter, table

SSW06, SSW07, SSW900, SST = 1, 2, 3, 4
SIMULATED = "line.starter.simulated"
SITE = (
    table("gateway", name="walk")
    + table("mqtt", url="mqtt://127.0.0.1:1")
    + line("hall", port="PORT")
    + starter("a", SSW06, "ssw06", model="SSW-06 950A")
    + table(SIMULATED, firmware="1.71", parameters={"P251": 7, "P630": 2}, braking_s=0.5)
    + starter("b", SSW07, "ssw07", model="SSW-07 85A")
    + table(SIMULATED, firmware="1.30")
    + starter("c", SSW900, "ssw900", slot=2)
    + table(SIMULATED, markers={"DI100": True, "DI101": False, "DI102": True, "COIL200": False})
    + starter("d", SST, "sst", model="SST330i")
    + table(SIMULATED, firmware="4.21")
)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    folder = tmp_path_factory.mktemp("walk")
    config = folder / "site.toml"
    config.write_text(SITE.replace("PORT", str(folder / "line")), "utf-8")
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway", "simulate", str(config)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith("line hall:")
    client = Client(str(folder / "line"), baud=19200, stop_bits=2)
    yield client
    client.close()
    process.terminate()
    process.communicate(timeout=10)


def code(ask: Callable[[], object]) -> int:
    """Return the exception that this is answered with."""
    with pytest.raises(ModbusExceptionError) as error:
        ask()
    return error.value.code


def test_the_client_imports_nothing_of_the_product() -> None:
    tree = ast.parse(Path(independent_client.__file__).read_text("utf-8"))
    imported = {
        name
        for node in ast.walk(tree)
        for name in (
            [each.name for each in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }

    assert imported <= {"__future__", *sys.stdlib_module_names}


@pytest.mark.parametrize(
    "frame",
    [
        "01 03 00 02 00 02 65 CB",
        "01 03 04 01 F4 01 90 BB C1",
        "01 01 00 01 00 02 EC 0B",
    ],  # ssw07 5.4.1, 5.4.2
)
def test_its_crc_is_that_of_the_manuals_examples(frame: str) -> None:
    data = bytes.fromhex(frame)

    assert independent_client.crc(data[:-2]) == data[-2:]


def test_frames_that_no_unit_may_answer_stay_without_an_answer(client: Client) -> None:
    body = bytes.fromhex("01 03 00 DC 00 01")

    assert client.raw(body + b"\0\0", patience_s=0.2) == b""  # wrong CRC
    other = bytes.fromhex("09 03 00 DC 00 01")
    assert client.raw(other + independent_client.crc(other), patience_s=0.2) == b""  # no such address
    everybody = bytes.fromhex("00 06 01 3A 00 00")
    assert client.raw(everybody + independent_client.crc(everybody), patience_s=0.2) == b""


def test_the_words_of_the_ssw06(client: Client) -> None:
    assert client.identification(SSW06) == {0: "WEG", 1: "SSW-06 950.0A", 2: "V1.71"}  # 5.4.7
    assert client.registers(SSW06, 5000) == [15]  # VB00
    assert client.registers(SSW06, 5001) == [0b0100_0001_0000_0010]  # VB01: enabled, remote, supply
    assert client.coils(SSW06, 0, 16) == [bool(0x4102 >> bit & 1) for bit in range(16)]
    assert client.registers(SSW06, 312) == [4]  # 2.2: 19200, 8N2
    assert code(lambda: client.write(SSW06, 312, 10)) == 3  # out of range
    assert code(lambda: client.registers(SSW06, 999)) == 2
    assert code(lambda: client.ask(SSW06, 4, bytes(4))) == 1  # 5.3.1
    assert code(lambda: client.write_coil(SSW06, 3, is_on=True)) == 3  # status bits are read-only

    began_s = time.monotonic()
    client.write_several(SSW06, 313, 0, 0)
    assert time.monotonic() - began_s > 2 * 0.010  # 5.3.1: 10 ms for each register

    client.write(SSW06, 5009, 8191)  # VB09: 50 %, P251 is serial
    assert client.registers(SSW06, 5009) == [8191]
    client.write(SSW06, 5010, 8191)  # VB10: P253 is not
    assert client.registers(SSW06, 5010) == [0]


def test_the_words_of_the_ssw07(client: Client) -> None:
    assert client.identification(SSW07) == {0: "WEG", 1: "SSW-07 85.0A", 2: "V1.30"}
    assert client.registers(SSW07, 23) == [130]
    assert client.registers(SSW07, 5001) == [0x4102]
    assert code(lambda: client.registers(SSW07, 5000)) == 2  # VB00 is the SSW-06's
    assert code(lambda: client.write(SSW07, 5001, 0)) == 3
    began_s = time.monotonic()
    client.write_several(SSW07, 313, 1, 0)
    assert time.monotonic() - began_s > 2 * 0.020

    client.write_coil(SSW07, 100, is_on=True)
    assert client.registers(SSW07, 5001)[0] & 0x0B == 0x0B
    client.write_coil(SSW07, 102, is_on=True)  # no jog before V1.4x
    assert client.registers(SSW07, 5001)[0] & 4 == 0
    client.write_coil(SSW07, 101, is_on=False)  # general disable
    assert client.registers(SSW07, 5001)[0] & 0x0003 == 0
    client.write_coil(SSW07, 101, is_on=True)
    client.write(SSW07, 5003, 0x0013)  # run, enable, remote: without a mask
    assert client.registers(SSW07, 5001)[0] & 0x0103 == 0x0103
    client.write(SSW07, 5003, 0x0000)  # stop, disable, local
    assert client.registers(SSW07, 5001)[0] & 0x0103 == 0


def test_the_words_of_the_ssw900(client: Client) -> None:
    assert client.registers(SSW900, 680)[0] & 0x0103 == 0x0102
    assert client.registers(SSW900, 686) == [0x0012]  # S5.2.6: slot 2, enable and remote
    assert code(lambda: client.registers(SSW900, 20000)) == 2
    assert client.registers(SSW900, 20000, 3) == [0, 0, 0]  # 7.3: three registers give no error
    assert code(lambda: client.write(SSW900, 732, 9)) == 3  # C8.2.3 has four values
    assert code(lambda: client.ask(SSW900, 4, bytes(4))) == 1

    assert client.bits(SSW900, 2, 100, 3) == [True, False, True]  # 7.1, 7.2.2: markers of the SoftPLC
    assert code(lambda: client.bits(SSW900, 2, 103, 1)) == 2
    client.write_coil(SSW900, 200, is_on=True)
    assert client.bits(SSW900, 1, 200, 1) == [True]
    assert code(lambda: client.bits(SSW900, 1, 0, 1)) == 2  # the status is no coil

    client.write(SSW900, 685, 0x0013)  # the other slot's word: no effect
    assert client.registers(SSW900, 680)[0] & 1 == 0
    client.write(SSW900, 686, 0x0013)
    assert client.registers(SSW900, 680)[0] & 0x1001 == 0x1000  # C5.7.1: the time before a start
    time.sleep(1.0)
    assert client.registers(SSW900, 680)[0] & 1 == 1
    client.write(SSW900, 686, 0x0010)  # general disable
    assert client.registers(SSW900, 680)[0] & 3 == 0
    assert client.registers(SSW900, 679) == [13]
    client.write(SSW900, 686, 0x0012)
    assert client.registers(SSW900, 680)[0] & 3 == 2


def test_the_words_of_the_sst(client: Client) -> None:
    assert client.registers(SST, 0, 4, function=4) == [330, 0x0106, 0x0204, 0x0001]
    assert code(lambda: client.registers(SST, 0)) == 1  # no FC03
    assert code(lambda: client.registers(SST, 0, 25, function=4)) == 4  # more than 54 bytes
    assert len(client.registers(SST, 0, 24, function=4)) == 24
    assert code(lambda: client.registers(SST, 43, function=4)) == 2
    assert client.coils(SST, 4, 2) == [True, True]  # initialised, phase sequence

    client.write_coil(SST, 0, is_on=True)
    assert client.registers(SST, 19, function=4) == [1]
    time.sleep(1.0)  # the faster it turns, the longer it stops
    assert code(lambda: client.write(SST, 30, 20)) == 2  # not in configuration mode: refused, and
    assert client.registers(SST, 19, function=4) == [3]  # the motor stops
    while client.registers(SST, 19, function=4) != [0]:
        time.sleep(0.05)

    client.write_coil(SST, 1, is_on=True)
    assert code(lambda: client.write_coil(SST, 0, is_on=True)) == 2  # not initialised
    assert code(lambda: client.write(SST, 32, 31)) == 3
    client.write(SST, 32, 21)
    client.write_coil(SST, 1, is_on=False)
    assert code(lambda: client.write_coil(SST, 0, is_on=True)) == 6  # the flash is being written
    time.sleep(0.4)
    assert client.coils(SST, 4, 1) == [True]
    assert client.registers(SST, 32, function=4) == [21]
