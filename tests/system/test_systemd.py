from __future__ import annotations

import io
import logging
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.system.systemd import Notifier, PriorityFormatter, is_journal, watchdog_interval_s


@pytest.fixture(params=["path", "abstract"])
def listener(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """Give a socket as systemd has it, and what NOTIFY_SOCKET says."""
    is_abstract = request.param == "abstract"
    address = f"@starter-gateway-test-{os.getpid()}" if is_abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind("\0" + address[1:] if is_abstract else address)
        listening.settimeout(5.0)
        yield listening, address


def test_everything_is_reported_to_systemd(listener: tuple[socket.socket, str]) -> None:
    listening, address = listener
    notifier = Notifier({"NOTIFY_SOCKET": address})

    notifier.ready("polling 3 starters")
    notifier.status("all\nwell")
    notifier.watchdog()
    notifier.stopping()
    notifier.reloading()

    assert listening.recv(1000) == b"READY=1\nSTATUS=polling 3 starters"
    assert listening.recv(1000) == b"STATUS=all well"
    assert listening.recv(1000) == b"WATCHDOG=1"
    assert listening.recv(1000) == b"STOPPING=1"
    assert listening.recv(1000).startswith(b"RELOADING=1\nMONOTONIC_USEC=")


def test_a_socket_that_is_gone_does_no_harm(tmp_path: Path) -> None:
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "gone")}).watchdog()


@pytest.mark.parametrize(
    ("environ", "interval_s"),
    [
        ({"WATCHDOG_USEC": "10000000"}, 5.0),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": str(os.getpid())}, 5.0),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({}, None),
    ],
)
def test_the_watchdog_is_fed_twice_within_its_limit(
    environ: dict[str, str], interval_s: float | None
) -> None:
    assert watchdog_interval_s(environ) == interval_s


def test_the_journal_is_known_by_device_and_inode(tmp_path: Path) -> None:
    with (tmp_path / "log").open("w") as stream:
        status = os.fstat(stream.fileno())

        assert is_journal({"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}, stream)
        assert not is_journal({"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino + 1}"}, stream)
        assert not is_journal({}, stream)
        assert not is_journal({"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}, io.StringIO())


@pytest.mark.parametrize(
    ("level", "mark"),
    [
        (logging.DEBUG, "<7>"),
        (logging.INFO, "<6>"),
        (logging.WARNING, "<4>"),
        (logging.ERROR, "<3>"),
        (logging.CRITICAL, "<2>"),
        (1, "<7>"),
    ],
)
def test_a_log_line_begins_with_its_priority(level: int, mark: str) -> None:
    record = logging.LogRecord("gateway.line", level, "x.py", 1, "line=%s went silent", ("pumps",), None)

    assert PriorityFormatter().format(record) == f"{mark}gateway.line: line=pumps went silent"
