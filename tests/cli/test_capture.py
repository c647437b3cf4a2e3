"""`capture`: the frames that a gateway offers on its socket, in a file that Wireshark reads."""

from __future__ import annotations

import asyncio
import contextlib
import json
import select
import socket
import stat
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from gateway.app import capture_socket
from gateway.app.capture_socket import CaptureSocket
from gateway.cli.main import main
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.system.clock import Clock
from tests.config.sites import SITE
from tests.programs import program
from tests.tshark import dissect, summaries
from tests.waiting import until

EPOCH_S = 1_760_000_000.000001
READ = ReadHoldingRegisters(3, 2)
ASKED = adu.encode(1, READ.encode())
SAID = adu.encode(1, READ.encode_reply((500, 400)))
GARBLED = SAID[:-1] + bytes((SAID[-1] ^ 1,))
FRAMES = [
    ("pumps", 0.0, ">>", ASKED),
    ("pumps", 0.010123, "<<", SAID),
    ("fans", 0.02, ">>", ASKED),  # no one answers
    ("pumps", 0.03, ">>", ASKED),
    ("pumps", 0.04, "<<", GARBLED),
    ("fans", 0.05, "??", b"\x55\xaa"),
]


class StillClock(Clock):
    def utc_s(self, at_s: float | None = None) -> float:
        return EPOCH_S + (at_s or 0.0)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "site.toml"
    path.write_text(SITE.replace('name = "mcc1"', 'name = "mcc1"\nstate_dir = "state"'))
    (tmp_path / "state").mkdir()
    return path


@pytest.fixture
def path(config: Path) -> Path:
    """Return where the gateway of the configuration has its socket."""
    return config.parent / "state" / "mcc1.capture"


@contextlib.asynccontextmanager
async def serving(path: Path) -> AsyncIterator[asyncio.Queue[Any]]:
    """Serve the socket; what is yielded gets where frames are wanted, and None where there is no reader."""
    wanted = asyncio.Queue[Any]()
    task = asyncio.create_task(CaptureSocket(path, ["pumps", "fans"], wanted.put_nowait, StillClock()).run())
    await asyncio.sleep(0)
    yield wanted
    task.cancel()
    await asyncio.wait([task])


def mode(path: Path) -> int | None:
    return stat.S_IMODE(path.stat().st_mode) if path.exists() else None


def capture(config: Path, file: Path, *words: str) -> asyncio.Task[int]:
    return asyncio.create_task(asyncio.to_thread(main, ["capture", str(config), str(file), *words]))


async def test_a_capture_is_what_wireshark_reads_as_modbus_rtu(
    config: Path, path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program("tshark")
    file = tmp_path / "line.pcapng"

    async with serving(path) as wanted:
        capturing = capture(config, file, "--seconds", "0.5")
        on_frame = await wanted.get()
        for frame in FRAMES:
            on_frame(*frame)
        assert await capturing == 0
        assert await wanted.get() is None

    errors = capsys.readouterr().err
    assert "recording pumps, fans" in errors
    assert f"6 frames; look at them with: tshark -r {file} -d rtacser.data,mbrtu" in errors
    kinds = [summary.split(":")[0].strip() for summary in summaries(file)[:5]]
    assert kinds == ["Query", "Response", "Query", "Query", "Response"]
    frames = dissect(file)
    names = [frame["frame"]["frame.interface_id_tree"]["frame.interface_name"] for frame in frames]
    assert names == [line for line, *_ in FRAMES]
    assert frames[0]["frame"]["frame.time_epoch"] == "1760000000.000001000"
    assert frames[1]["frame"]["frame.time_delta"] == "0.010123000"
    assert frames[1]["mbrtu"]["mbrtu.unit_id"] == "1"
    assert frames[1]["modbus"]["Register 3 (UINT16): 500"]["modbus.regval_uint16"] == "500"
    assert [frame["mbrtu"]["mbrtu.crc16.status"] for frame in frames[:5]] == ["1", "1", "1", "1", "0"]
    assert frames[5]["data"]["data.data"] == "55:aa"
    assert [frame["rtacser"]["rtacser.eventtype"] for frame in frames[:2]] == ["0x01", "0x04"]


async def test_a_gateway_that_ends_meanwhile_is_reported_and_the_file_stored(
    config: Path, path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with serving(path) as wanted:
        capturing = capture(config, tmp_path / "line.pcapng")
        on_frame = await wanted.get()
        on_frame(*FRAMES[0])
        await asyncio.sleep(0)

    assert await capturing == 1
    errors = capsys.readouterr().err
    assert "the gateway has ended" in errors
    assert "1 frame; look at them with" in errors
    assert ASKED in (tmp_path / "line.pcapng").read_bytes()
    assert mode(path) is None  # nothing is left behind


@pytest.mark.parametrize("greeting", [{"capture": 2, "lines": []}, {}])
async def test_a_gateway_of_another_version_is_reported(
    config: Path, path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], greeting: dict[str, object]
) -> None:
    def greet(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(json.dumps(greeting).encode() + b"\n")
        writer.close()

    async with await asyncio.start_unix_server(greet, path):
        assert await capture(config, tmp_path / "x") == 1

    assert "of another version" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seconds", "0.1"], "mcc1.capture: the gateway does not answer"),
        ([], "the gateway has ended"),
    ],
)
async def test_a_gateway_that_stands_still_or_is_killed_then_is_reported(
    config: Path, path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    with socket.socket(socket.AF_UNIX) as gateway:
        gateway.bind(str(path))
        gateway.listen()
        capturing = capture(config, config.with_name("x"), *words)
        await (asyncio.wait([capturing]) if words else until(lambda: select.select([gateway], [], [], 0)[0]))

    assert await capturing == 1
    assert said in capsys.readouterr().err


async def test_only_the_gateways_user_may_connect_also_where_a_killed_gateway_left_its_socket(
    path: Path,
) -> None:
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))

    async with serving(path):
        assert mode(path) == 0o600
        reader, writer = await asyncio.open_unix_connection(path)
        assert json.loads(await reader.readline()) == {"capture": 1, "lines": ["pumps", "fans"]}
        writer.close()


async def test_a_reader_that_is_too_slow_is_cut_off(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(capture_socket, "MOST_UNSENT_BYTES", 10_000)
    async with serving(path) as wanted:
        _, writer = await asyncio.open_unix_connection(path)
        on_frame = await wanted.get()

        while not caplog.text:
            on_frame("pumps", 0.0, ">>", bytes(256))
        assert await wanted.get() is None
        writer.close()

    assert "too slow" in caplog.text
