"""One gateway for one state directory, whatever the disk and the user."""

from __future__ import annotations

import fcntl
import logging
import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from gateway.errors import StartError
from gateway.system.instance_lock import FILE, instance_lock, is_locked, may_use
from tests.ordinary_user import give

HOLD = """
import sys
import tempfile
from pathlib import Path
from gateway.errors import StartError
from gateway.system.instance_lock import instance_lock
from tests.ordinary_user import become_ordinary
become_ordinary()
try:
    with instance_lock(Path(sys.argv[1])):
        print("held", flush=True)
        sys.stdin.read()
except StartError as error:
    print(error, flush=True)
"""


def holder(state_dir: Path) -> subprocess.Popen[str]:
    """Return a process of an ordinary user that takes the lock, says so, and holds it."""
    command = [sys.executable, "-c", HOLD, str(state_dir)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def said(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().rstrip("\n")


def test_a_second_one_is_refused_and_names_the_process_of_the_first(tmp_path: Path) -> None:
    with (
        instance_lock(tmp_path / "state"),
        pytest.raises(StartError, match=rf"another gateway \(pid {os.getpid()}\) .*state .*stop that one"),
        instance_lock(tmp_path / "state"),
    ):
        pass


def test_the_holder_on_another_machine_or_in_another_container_is_named_with_its_host(tmp_path: Path) -> None:
    with instance_lock(tmp_path):
        (tmp_path / FILE).write_text("1 plc-box\n")

        with pytest.raises(StartError, match="pid 1 on plc-box"), instance_lock(tmp_path):
            pass


def test_the_lock_ends_with_a_process_that_was_killed(tmp_path: Path) -> None:
    make_reachable(tmp_path)
    with holder(tmp_path) as first:
        assert said(first) == "held"
        with holder(tmp_path) as second:
            assert f"pid {first.pid}" in said(second)
        first.send_signal(signal.SIGKILL)

    with holder(tmp_path) as third:
        assert said(third) == "held"
        third.kill()


def test_a_folder_of_another_user_is_reported_in_one_line_with_its_remedy(tmp_path: Path) -> None:
    make_reachable(tmp_path)
    locked = tmp_path / "state"
    locked.mkdir()
    locked.chmod(0o500)  # of another user's folder the same is true

    with holder(locked) as process:
        line = said(process)

    assert line.startswith(f"state_dir {locked}: user ")
    assert "may not write there (set state_dir in [gateway] to a folder of this user" in line
    assert f"sudo install -d -m 700 -o {os.getuid() or 65534} {locked}" in line


def test_a_file_system_without_locks_prevents_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)

    with caplog.at_level(logging.WARNING), instance_lock(tmp_path):
        pass

    assert "No locks available" in caplog.text


def make_reachable(folder: Path) -> None:
    """Let the ordinary user own this folder and pass through those above it."""
    give(folder)
    if os.geteuid() == 0:
        for above in folder.parents[:3]:
            if above.stat().st_uid == 0 and Path(tempfile.gettempdir()) in above.parents:
                above.chmod(above.stat().st_mode | 0o011)


def test_a_port_across_a_network_counts_as_held_where_that_cannot_be_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert may_use("socket://server:4001", tmp_path)

    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)

    assert not may_use("socket://server:4001", tmp_path)
    assert may_use("/dev/ttyUSB0", tmp_path)  # it has a lock of its own


def test_a_folder_says_whether_a_gateway_runs_there(tmp_path: Path) -> None:
    assert not is_locked(tmp_path / "nowhere")
    with instance_lock(tmp_path):
        assert is_locked(tmp_path)
        assert is_locked(tmp_path)  # to ask changes nothing
    assert not is_locked(tmp_path)


def test_the_lock_ends_with_the_context_and_its_file_is_for_its_user_only(tmp_path: Path) -> None:
    for _ in range(2):
        with instance_lock(tmp_path / "state"):
            pass

    assert (tmp_path / "state" / FILE).stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "state").stat().st_mode & 0o777 == 0o700
    assert (tmp_path / "state" / FILE).read_text() == f"{os.getpid()} {socket.gethostname()}\n"
