"""Record a running gateway's lines for Wireshark's Modbus RTU dissector; Ctrl-C ends it.

It reads the frames from the gateway's socket and writes a pcapng file, little-endian
[draft-ietf-opsawg-pcapng]. The link type is that of serial lines recorded by an RTAC: it carries the
direction, and Wireshark can pass the bytes to its Modbus RTU dissector (LINKTYPE_RTAC_SERIAL, Wireshark's
packet-rtacser.c).
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import shlex
import struct
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

from gateway.app.capture_socket import FORMAT, socket_path
from gateway.cli.command import counted
from gateway.config import load
from gateway.errors import CaptureError, UsageError

READ_WITH = "-d rtacser.data,mbrtu -o mbrtu.crc_verification:TRUE"  # what Wireshark and tshark need
MOST_SECONDS = 1e7  # four months

SECTION, INTERFACE, PACKET = 0x0A0D0D0A, 1, 6  # types of blocks
BYTE_ORDER_MAGIC, VERSION, LENGTH_UNKNOWN = 0x1A2B3C4D, 1, -1
LINKTYPE_RTAC_SERIAL = 250
IF_NAME = 2  # option
DATA_TX_START, DATA_RX_END = 0x01, 0x04


def section(lines: Iterable[str]) -> bytes:
    """Return the beginning of a file: one interface for each line."""
    head = struct.pack("<IHHq", BYTE_ORDER_MAGIC, VERSION, 0, LENGTH_UNKNOWN)
    found = _block(SECTION, head)
    for line in lines:
        name = struct.pack("<HH", IF_NAME, len(line)) + _padded(line.encode()) + bytes(4)  # end of options
        found += _block(INTERFACE, struct.pack("<HHI", LINKTYPE_RTAC_SERIAL, 0, 0) + name)
    return found


def packet(interface: int, time_us: int, direction: str, frame: bytes) -> bytes:
    """Return a frame: >> began then, anything else ended then."""
    event = DATA_TX_START if direction == ">>" else DATA_RX_END
    # Seconds, microseconds, event, control lines, footer; then the bytes of the line.
    data = struct.pack(">IIBBH", *divmod(time_us, 1_000_000), event, 0, 0) + frame
    head = struct.pack("<IIIII", interface, time_us >> 32, time_us & 0xFFFF_FFFF, len(data), len(data))
    return _block(PACKET, head + _padded(data))


def _block(kind: int, body: bytes) -> bytes:
    length = struct.pack("<I", len(body) + 12)
    return struct.pack("<I", kind) + length + body + length


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = f"{parser.description} Read it with: tshark -r FILE {READ_WITH}"
    parser.add_argument("config", metavar="CONFIG", help="the running gateway's TOML file")
    parser.add_argument("file", metavar="FILE.pcapng", help="is overwritten")
    parser.add_argument("--seconds", type=float, metavar="N", help="end by itself after so long")


def run(args: argparse.Namespace) -> int:
    """Record until interrupted or the time is up; CaptureError when the gateway does not run, or ends."""
    if args.seconds is not None and not 0 < args.seconds <= MOST_SECONDS:
        raise UsageError(
            f"--seconds {args.seconds:g} is out of range (more than 0, at most {MOST_SECONDS:g})"
        )
    config_path = Path(args.config)
    path = socket_path(load(config_path), config_path.parent)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_record(path, Path(args.file), args.seconds))
    return 0


async def _record(path: Path, target: Path, seconds: float | None) -> None:
    """Write the frames of a running gateway to a file; None: until cancelled. CaptureError."""
    try:
        reader, writer = await asyncio.open_unix_connection(path)
    except OSError as error:
        hint = "is this gateway running, and are you its user?"
        raise CaptureError(f"{path}: {error.strerror or error} ({hint})") from error
    with contextlib.closing(writer):
        try:
            greeting = await asyncio.wait_for(_message(reader), seconds)
        except TimeoutError:
            raise CaptureError(f"{path}: the gateway does not answer (is it stopped?)") from None
        if greeting.get("capture") != FORMAT:
            raise CaptureError(f"{path}: the running gateway is of another version (restart it)")
        numbers = {line: number for number, line in enumerate(greeting["lines"])}
        with _opened(target) as file:
            file.write(section(numbers))
            print(f"recording {', '.join(numbers)}; Ctrl-C ends it", file=sys.stderr)
            count = 0
            try:
                async with asyncio.timeout(seconds):
                    while True:
                        frame = await _message(reader)
                        content = bytes.fromhex(frame["frame"])
                        number, time_us = numbers[frame["line"]], frame["time_us"]
                        file.write(packet(number, time_us, frame["direction"], content))
                        file.flush()
                        count += 1
            except TimeoutError:  # as it was asked to
                pass
            finally:  # the file is whole, however the recording has ended
                look = f"look at them with: tshark -r {shlex.quote(str(target))} {READ_WITH}"
                print(f"{counted(count, 'frame')}; {look}", file=sys.stderr)


async def _message(reader: asyncio.StreamReader) -> dict[str, Any]:
    """Return the gateway's next message; CaptureError when it ends before."""
    try:
        message: dict[str, Any] = json.loads(await reader.readuntil())
    except (EOFError, ConnectionError) as error:
        raise CaptureError("the gateway has ended, or found this capture too slow") from error
    return message


def _opened(path: Path) -> BinaryIO:
    """Return a file to write, in place of one that is there."""
    try:
        return path.open("wb")
    except OSError as error:
        raise CaptureError(f"{path}: {error.strerror} (choose another folder)") from error
