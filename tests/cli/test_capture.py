from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.cli.main import main
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters
from tests.config.sites import SITE
from tests.tshark import dissect, need_tshark, summaries

START_US = 1_760_000_000_000_001
READ = ReadHoldingRegisters(3, 2)
ASKED = adu.encode(1, READ.encode())
SAID = adu.encode(1, READ.encode_reply((500, 400)))
GARBLED = SAID[:-1] + bytes((SAID[-1] ^ 1,))


def reported(line: str, time_us: int, direction: str, frame: bytes) -> dict[str, Any]:
    return {"line": line, "time_us": time_us, "direction": direction, "frame": frame.hex()}


GREETING = {"capture": 1, "lines": ["pumps", "fans"]}
FRAMES = [
    reported("pumps", START_US, ">>", ASKED),
    reported("pumps", START_US + 10_123, "<<", SAID),
    reported("fans", START_US + 20_000, ">>", ASKED),  # no one answers
    reported("pumps", START_US + 30_000, ">>", ASKED),
    reported("pumps", START_US + 40_000, "<<", GARBLED),
    reported("fans", START_US + 50_000, "??", b"\x55\xaa"),
]


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "site.toml"
    path.write_text(SITE.replace('name = "mcc1"', 'name = "mcc1"\nstate_dir = "state"'))
    (tmp_path / "state").mkdir()
    return path


@contextlib.contextmanager
def gateway(config: Path, messages: list[dict[str, Any]]) -> Iterator[None]:
    """Stand in for a gateway that sends this to each client, and ends."""

    def serve() -> None:
        data = b"".join(json.dumps(message).encode() + b"\n" for message in messages)
        connection, _ = listening.accept()
        with connection, contextlib.suppress(ConnectionError):  # the other side may have enough at any time
            connection.sendall(data[:37])  # in pieces that end anywhere
            connection.sendall(data[37:])
            connection.recv(1)  # until the other side has enough

    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(config.parent / "state" / "mcc1.capture"))
        listening.listen(1)
        thread = threading.Thread(target=serve)
        thread.start()
        yield
        thread.join()


def test_a_capture_is_what_wireshark_reads_as_modbus_rtu(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    need_tshark()
    file = tmp_path / "line.pcapng"

    with gateway(config, [GREETING, *FRAMES]):
        assert main(["capture", str(config), str(file), "--seconds", "0.5"]) == 0

    errors = capsys.readouterr().err
    assert "recording pumps, fans" in errors
    assert f"6 frames; look at them with: tshark -r {file} -d rtacser.data,mbrtu" in errors
    assert [summary.split(":")[0].strip() for summary in summaries(file)[:5]] == [
        "Query",
        "Response",
        "Query",
        "Query",
        "Response",
    ]
    frames = dissect(file)
    assert [frame["frame"]["frame.interface_id_tree"]["frame.interface_name"] for frame in frames] == [
        "pumps",
        "pumps",
        "fans",
        "pumps",
        "pumps",
        "fans",
    ]
    assert frames[0]["frame"]["frame.time_epoch"] == "1760000000.000001000"
    assert frames[1]["frame"]["frame.time_delta"] == "0.010123000"
    assert frames[1]["mbrtu"]["mbrtu.unit_id"] == "1"
    assert frames[1]["modbus"]["Register 3 (UINT16): 500"]["modbus.regval_uint16"] == "500"
    assert [frame["mbrtu"]["mbrtu.crc16.status"] for frame in frames[:5]] == ["1", "1", "1", "1", "0"]
    assert frames[5]["data"]["data.data"] == "55:aa"
    assert [frame["rtacser"]["rtacser.eventtype"] for frame in frames[:2]] == ["0x01", "0x04"]


def test_a_gateway_that_ends_meanwhile_is_reported_and_the_file_stored(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "line.pcapng"
    received = socket.socket.recv
    monkeypatch.setattr(socket.socket, "recv", lambda self, size: received(self, size) if size > 1 else b"")

    with gateway(config, [GREETING, *FRAMES]):
        assert main(["capture", str(config), str(file)]) == 1

    assert "the gateway has ended" in capsys.readouterr().err
    assert file.stat().st_size > 300


@pytest.mark.parametrize("greeting", [{"capture": 2, "lines": []}, {}])
def test_a_gateway_of_another_version_is_reported(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], greeting: dict[str, Any]
) -> None:
    with gateway(config, [greeting]):
        assert main(["capture", str(config), str(tmp_path / "x")]) == 1

    assert "of another version" in capsys.readouterr().err
