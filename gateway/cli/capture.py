"""`starter-gateway capture`: records a running gateway's lines for Wireshark.

It reads the frames from the gateway's socket and writes a pcapng file; no other module imports python-pcapng.
The link type is that of serial lines recorded by an RTAC: it carries the direction, and Wireshark can pass
the bytes to its Modbus RTU dissector (LINKTYPE_RTAC_SERIAL, Wireshark's packet-rtacser.c).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import shlex
import socket
import struct
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from gateway.app.capture_socket import FORMAT, socket_path
from gateway.config.load import load
from gateway.errors import CaptureError, UsageError

LINKTYPE_RTAC_SERIAL = 250
READ_WITH = "-d rtacser.data,mbrtu -o mbrtu.crc_verification:TRUE"  # what Wireshark and tshark need

_DATA_TX_START, _DATA_RX_END = 0x01, 0x04
MOST_SECONDS = 1e7  # four months
_HEADER = ">IIBBH"  # seconds, microseconds, event, control lines, footer
_MICROSECONDS = 1_000_000


class CaptureFile:
    """Writes one interface for each line; the file is whole after every frame."""

    def __init__(self, path: Path, lines: Iterable[str]) -> None:
        try:
            from pcapng import FileWriter, blocks
        except ImportError as error:
            raise CaptureError("python-pcapng is missing (pip install 'starter-gateway[capture]')") from error
        section = blocks.SectionHeader(options={"shb_userappl": "starter-gateway"})
        self._interfaces = {line: number for number, line in enumerate(lines)}
        for line in self._interfaces:
            section.new_member(
                blocks.InterfaceDescription,
                link_type=LINKTYPE_RTAC_SERIAL,
                options={"if_name": line, "if_description": "Modbus RTU"},
            )
        self._section: Any = section
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise CaptureError(f"{path}: {error.strerror}") from error
        self._packet, self._writer = blocks.EnhancedPacket, FileWriter(self._file, section)

    def write(self, line: str, time_us: int, direction: str, frame: bytes) -> None:
        """Append a frame: >> began then, anything else ended then."""
        event = _DATA_TX_START if direction == ">>" else _DATA_RX_END
        seconds, microseconds = divmod(time_us, _MICROSECONDS)
        data = struct.pack(_HEADER, seconds, microseconds, event, 0, 0) + frame
        self._writer.write_block(
            self._section.new_member(
                self._packet,
                interface_id=self._interfaces[line],
                timestamp_high=time_us >> 32,
                timestamp_low=time_us & 0xFFFF_FFFF,
                packet_len=len(data),
                captured_len=len(data),
                packet_data=data,
            )
        )
        self._file.flush()

    def close(self) -> None:
        """Write nothing more."""
        self._file.close()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's description and arguments."""
    parser.description = (
        "Record a running gateway's lines for Wireshark's Modbus RTU dissector; Ctrl-C ends it. "
        f"Read it with: tshark -r FILE {READ_WITH}"
    )
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
    end_s = None if args.seconds is None else time.monotonic() + args.seconds
    with connected(path) as connection:
        messages = _messages(connection, end_s)
        lines = _lines(next(messages, {}), path)
        count = 0
        with contextlib.closing(CaptureFile(Path(args.file), lines)) as file:
            print(f"recording {', '.join(lines)}; Ctrl-C ends it", file=sys.stderr)
            with contextlib.suppress(KeyboardInterrupt):
                for frame in messages:
                    content = bytes.fromhex(frame["frame"])
                    file.write(frame["line"], frame["time_us"], frame["direction"], content)
                    count += 1
    print(
        f"{count} frames; look at them with: tshark -r {shlex.quote(args.file)} {READ_WITH}", file=sys.stderr
    )
    return 0


@contextlib.contextmanager
def connected(path: Path) -> Iterator[socket.socket]:
    """Give a connection to a running gateway's frames."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        try:
            connection.connect(str(path))
        except OSError as error:
            hint = "is this gateway running, and are you its user?"
            raise CaptureError(f"{path}: {error.strerror or error} ({hint})") from error
        yield connection


def _messages(connection: socket.socket, end_s: float | None) -> Iterator[dict[str, Any]]:
    """Yield the gateway's messages until the time is up; CaptureError when it ends before."""
    received = b""
    while True:
        left_s = None if end_s is None else end_s - time.monotonic()
        if left_s is not None and left_s <= 0:
            return
        connection.settimeout(left_s)
        try:
            chunk = connection.recv(65_536)
        except TimeoutError:
            return
        except OSError:
            chunk = b""
        if not chunk:
            raise CaptureError("the gateway has ended, or found this capture too slow")
        *messages, received = (received + chunk).split(b"\n")
        yield from map(json.loads, messages)


def _lines(greeting: dict[str, Any], path: Path) -> list[str]:
    if greeting.get("capture") != FORMAT:
        raise CaptureError(f"{path}: the running gateway is of another version (restart it)")
    return list(greeting["lines"])
