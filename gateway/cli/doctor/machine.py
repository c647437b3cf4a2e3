"""Problems of the machine: adapters, the clock, the state directory and its contents."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from pathlib import Path

from gateway.cli.doctor.finding import DoctorFinding
from gateway.errors import DamagedError
from gateway.families.devices.findings import Weight
from gateway.starters.policy.write_budget import WEAR_FILE, WRITES_BORNE, totals_in
from gateway.storage.json_file import JsonFile

SYSFS_TTY = Path("/sys/class/tty")
LONGEST_LATENCY_MS = 2  # a driver's timer above this delays every reply by as much

_TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised
_TIMEX_BYTES = 512  # more than struct timex has anywhere


def latency_remark(port: str, where: str, *, sysfs: Path = SYSFS_TTY) -> DoctorFinding | None:
    """Return the finding about an adapter's latency timer; None when it has none."""
    name = Path(port).resolve().name
    timer = sysfs / name / "device" / "latency_timer"
    try:
        milliseconds = int(timer.read_text("ascii"))
    except (OSError, ValueError):
        return None
    if milliseconds <= LONGEST_LATENCY_MS:
        return DoctorFinding(where, f"the adapter's latency timer is {milliseconds} ms")
    what = f"the adapter holds replies back for up to {milliseconds} ms"
    return DoctorFinding(
        where, f"{what} (echo 1 > {timer}, or install the udev rule of deploy/)", Weight.WARNING
    )


def clock_state() -> int | None:
    """Return what adjtimex(2) says of the clock, None where there is no such call; nothing is changed."""
    try:
        adjtimex = ctypes.CDLL(None, use_errno=True).adjtimex
    except (OSError, AttributeError):
        return None
    state = adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))  # modes = 0: only read
    return None if state < 0 else int(state)


def clock_remark(read: Callable[[], int | None] = clock_state) -> DoctorFinding:
    """Return whether the clock is synchronised: times in topics and `issued_at` of commands depend on it."""
    state = read()
    if state is None:
        return DoctorFinding("clock", "whether it is synchronised is unknown here", Weight.NOTE)
    if state == _TIME_ERROR:
        what = "is not synchronised: time stamps are wrong, commands need `token`, not `issued_at`"
        return DoctorFinding(
            "clock", f"{what} (install chrony, or switch systemd-timesyncd on)", Weight.WARNING
        )
    return DoctorFinding("clock", "is synchronised")


def wear_remarks(folder: Path) -> list[DoctorFinding]:
    """Return how often the gateway of this state directory has written to the starters' memories."""
    try:
        writes = totals_in(JsonFile(folder / WEAR_FILE).load() or {"writes": {}})
    except DamagedError as error:
        return [DoctorFinding("state_dir", f"{error}", Weight.NOTE)]
    return [_wear_remark(starter, count) for starter, count in sorted(writes.items())]


def _wear_remark(starter: str, count: int) -> DoctorFinding:
    times = "once" if count == 1 else f"{count} times"
    what = f"this gateway has written {times} to its non-volatile memory"
    if count < WRITES_BORNE:
        return DoctorFinding(f"starter {starter}", what)
    hint = (
        f"flash is usually made for {WRITES_BORNE}: find the program that writes the same setting repeatedly"
    )
    return DoctorFinding(f"starter {starter}", f"{what} ({hint})", Weight.WARNING)


def state_dir_remark(folder: Path) -> DoctorFinding:
    """Return whether the state directory is there and may be written."""
    if folder.is_dir():
        if os.access(folder, os.W_OK | os.X_OK):
            return DoctorFinding("state_dir", f"{folder} may be written")
        what = "may not be written by this user"
        return DoctorFinding("state_dir", f"{folder} {what} (chown it to the gateway's user)", Weight.ERROR)
    if folder.exists():
        return DoctorFinding("state_dir", f"{folder} is no folder (choose another one)", Weight.ERROR)
    return DoctorFinding("state_dir", f"{folder} is not there (make it for the gateway's user)", Weight.ERROR)
