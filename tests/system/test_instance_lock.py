"""One gateway for one state directory, whatever the disk and the user."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import socket
from pathlib import Path
from typing import Any

import pytest

from gateway.errors import StartError
from gateway.system.instance_lock import FILE, instance_lock, is_locked, may_use


def test_a_second_one_is_refused_and_names_the_process_of_the_first(tmp_path: Path) -> None:
    state = tmp_path / "state"
    assert not is_locked(state)
    for _ in range(2):  # the lock ends with its context
        with instance_lock(state):
            assert is_locked(state)
            assert is_locked(state)  # to ask changes nothing
            with pytest.raises(StartError, match=rf"gateway \(pid {os.getpid()}\) .*stop that one"):
                instance_lock(state).__enter__()
        assert not is_locked(state)

    assert [path.stat().st_mode & 0o777 for path in (state, state / FILE)] == [0o700, 0o600]
    assert (state / FILE).read_text() == f"{os.getpid()} {socket.gethostname()}\n"


def test_the_holder_on_another_machine_or_in_another_container_is_named_with_its_host(tmp_path: Path) -> None:
    with instance_lock(tmp_path):
        (tmp_path / FILE).write_text("1 plc-box\n")

        with pytest.raises(StartError, match="pid 1 on plc-box"):
            instance_lock(tmp_path).__enter__()


@pytest.mark.parametrize(
    ("is_writable", "remedy"),
    [(False, "state: user .* may not write there .*install -d -m 700"), (True, "is another user's: .*chown")],
)
def test_what_this_user_may_not_write_is_reported_with_its_remedy(
    *, is_writable: bool, remedy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "open", _refuse)
    monkeypatch.setattr(os, "access", lambda *_: is_writable)

    with pytest.raises(StartError, match=remedy):
        instance_lock(tmp_path / "state").__enter__()


def test_a_disk_that_has_become_read_only_is_locked_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / FILE).touch()
    real = os.open

    def read_only(path: Any, flags: int, *args: int) -> int:
        if flags & os.O_RDWR:
            raise OSError(errno.EROFS, "Read-only file system")
        return real(path, flags, *args)

    monkeypatch.setattr(os, "open", read_only)

    with instance_lock(tmp_path), pytest.raises(StartError, match="another gateway"):
        instance_lock(tmp_path).__enter__()


def test_a_file_system_without_locks_prevents_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)

    with caplog.at_level(logging.WARNING), instance_lock(tmp_path):
        pass

    assert "No locks available" in caplog.text


def test_a_port_across_a_network_counts_as_held_where_that_cannot_be_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert may_use("socket://server:4001", tmp_path)
    monkeypatch.setattr(os, "open", _refuse)

    assert not may_use("socket://server:4001", tmp_path)
    assert may_use("/dev/ttyUSB0", tmp_path)  # it has a lock of its own


def _refuse(*_: object) -> int:
    raise PermissionError(13, "Permission denied")
