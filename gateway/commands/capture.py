"""`starter-gateway capture`: records a running gateway's lines for Wireshark."""

from __future__ import annotations

import argparse
import contextlib
import json
import shlex
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gateway.capture_socket import FORMAT, socket_path
from gateway.commands.capture_file import READ_WITH, CaptureFile
from gateway.commands.command import Subparsers
from gateway.config.load import load
from gateway.errors import CaptureError


def add_parser(subparsers: Subparsers) -> None:
    """Add the command's parser."""
    parser = subparsers.add_parser(
        "capture",
        description="Record a running gateway's lines for Wireshark's Modbus RTU dissector; Ctrl-C ends it. "
        f"Read it with: tshark -r FILE {READ_WITH}",
    )
    parser.add_argument("config", metavar="CONFIG", help="the running gateway's TOML file")
    parser.add_argument("file", metavar="FILE.pcapng", help="is overwritten")
    parser.add_argument("--seconds", type=float, metavar="N", help="end by itself after so long")


def run(args: argparse.Namespace) -> int:
    """Record until interrupted or the time is up; CaptureError when the gateway does not run, or ends."""
    config_path = Path(args.config)
    path = socket_path(load(config_path), config_path.parent)
    end_s = None if args.seconds is None else time.monotonic() + args.seconds
    with connected(path) as connection:
        told = _messages(connection, end_s)
        lines = _lines(next(told, {}), path)
        count = 0
        with CaptureFile(Path(args.file), lines) as file:
            print(f"recording {', '.join(lines)}; Ctrl-C ends it", file=sys.stderr)
            with contextlib.suppress(KeyboardInterrupt):
                for frame in told:
                    file.write(
                        frame["line"], frame["time_us"], frame["direction"], bytes.fromhex(frame["frame"])
                    )
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
            mend = "is this gateway running, and are you its user?"
            raise CaptureError(f"{path}: {error.strerror or error} ({mend})") from error
        yield connection


def _messages(connection: socket.socket, end_s: float | None) -> Iterator[dict[str, Any]]:
    """Yield what the gateway tells until the time is up; CaptureError when it ends before."""
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
