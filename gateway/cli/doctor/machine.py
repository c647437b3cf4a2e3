"""Findings, and those of the machine: speed, adapters, clock, the state directory and its contents."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gateway.cli.doctor.speed import BoxSpeed, measured
from gateway.config.schema import Config
from gateway.errors import StoreError
from gateway.families import Weight
from gateway.starters import BY_ISSUED_AT, WRITES, WRITES_BORNE, dated_alone
from gateway.store import INTEND_WITHIN_S, STATE_FILE, backup, read_document
from gateway.system.clock import ClockWatch, is_kernel_clock_synchronised, kernel_says_synchronised


@dataclass(frozen=True, slots=True)
class DoctorFinding:
    """One thing looked at; `weight` is None when all is well."""

    where: str
    text: str
    weight: Weight | None = None

    @property
    def is_problem(self) -> bool:
        """Return whether a person should act on it."""
        return self.weight in (Weight.WARNING, Weight.ERROR)

    def __str__(self) -> str:
        return f"{self.weight or 'ok':8}{self.where}: {self.text}"


SYSFS_TTY = Path("/sys/class/tty")
SLOW_DISK_S = 0.25  # a start waits so long for the disk without a person noticing it
LONGEST_LATENCY_MS = 2  # a driver's timer above this delays every reply by as much


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
    hint = f"echo 1 > {timer}, or install the udev rule of deploy/"
    return DoctorFinding(where, f"{what} ({hint})", Weight.WARNING)


def clock_remark(ask: Callable[[], bool | None] = kernel_says_synchronised) -> DoctorFinding:
    """Return whether the clock is synchronised: times in topics depend on it."""
    is_synchronised = ask()
    if is_synchronised is None:
        return DoctorFinding("clock", "whether it is synchronised is unknown here", Weight.NOTE)
    if not is_synchronised:
        what = "is not synchronised: time stamps may be wrong"
        hint = "install chrony, or switch systemd-timesyncd on"
        return DoctorFinding("clock", f"{what} ({hint})", Weight.WARNING)
    return DoctorFinding("clock", "is synchronised")


def dated_remark(
    config: Config, ask: Callable[[], bool] = is_kernel_clock_synchronised
) -> DoctorFinding | None:
    """Return the finding about operators of `issued_at` alone on a machine whose clock proves nothing."""
    clients = dict.fromkeys(each.client for each in config.operators if each.freshness == BY_ISSUED_AT)
    doubt = ClockWatch(config.gateway.clock, ask=ask).doubt()
    if not clients or doubt is None:
        return None
    return DoctorFinding(f"operator {', '.join(clients)}", dated_alone(doubt).text, Weight.WARNING)


def wear_remarks(folder: Path) -> list[DoctorFinding]:
    """Return how often the gateway of this state directory has written to the starters' memories."""
    try:
        writes = read_document(folder / STATE_FILE, "writes", WRITES) or {}
    except StoreError as error:
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
    """Return whether the state directory, and all that is the gateway's in it, may be written."""
    trouble = _state_dir_trouble(folder)
    return DoctorFinding(
        "state_dir", trouble or f"{folder} may be written", Weight.ERROR if trouble else None
    )


def _state_dir_trouble(folder: Path) -> str:
    if not folder.exists():
        return f"{folder} is not there (make it for the gateway's user)"
    if not folder.is_dir():
        return f"{folder} is no folder (choose another one)"
    if not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
        return f"{folder} may not be written by this user (chown it to the gateway's user)"
    foreign = [str(path) for path in _foreign_in(folder)]
    if not foreign:
        return ""
    more = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
    what = f"{foreign[0]}{more} in it may not be written by the gateway's user"
    return f"{what} (chown -R that user: {folder})"


def _foreign_in(folder: Path) -> Iterator[Path]:
    """Yield what this user may not write; for root, who may, what is not the folder's owner's."""
    owner = folder.stat().st_uid
    for path in backup.own_files(folder):
        with suppress(OSError):  # removed meanwhile
            is_another = os.geteuid() == 0 and path.lstat().st_uid != owner
            if is_another or (path.exists() and not os.access(path, os.R_OK | os.W_OK)):
                yield path


LATE_S = 0.001  # of a wait, in the middle: costs a line at 19200 bit/s a twentieth of its time


async def box_remarks(state_dir: Path) -> list[DoctorFinding]:
    """Measure this machine and return what was found."""
    return list(judged(await measured(state_dir)))


def judged(speed: BoxSpeed) -> Iterator[DoctorFinding]:
    """Give the findings about a measured machine."""
    yield _timers(speed)
    if speed.sync_s is not None:
        yield _disk(speed.sync_s)


def _timers(speed: BoxSpeed) -> DoctorFinding:
    late = f"waits end {speed.timer_late_s * 1e3:.1f} ms late, at most {speed.timer_worst_s * 1e3:.1f} ms"
    if speed.timer_late_s <= LATE_S:
        return DoctorFinding("timers", late)
    what = f"{late}: every transaction takes so much longer (see what else runs)"
    return DoctorFinding("timers", what, Weight.WARNING)


def _disk(sync_s: float) -> DoctorFinding:
    what = f"a write to state_dir is on the disk after {sync_s * 1e3:.0f} ms"
    if sync_s <= SLOW_DISK_S:
        return DoctorFinding("disk", what)
    hint = "another disk, or nothing else that writes to this one"
    if sync_s <= INTEND_WITHIN_S:
        return DoctorFinding("disk", f"{what}: every start waits for it ({hint})", Weight.WARNING)
    return DoctorFinding("disk", f"{what}: starts are refused, ledger_unavailable ({hint})", Weight.ERROR)
