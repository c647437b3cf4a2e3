"""Findings of the machine: timers, disk, adapters, clock, the state directory and its contents."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

from gateway.cli.doctor.findings import Finding
from gateway.config import Config
from gateway.families import Weight
from gateway.starters import BY_ISSUED_AT, dated_alone
from gateway.store import INTEND_WITHIN_S, backup
from gateway.system.clock import ClockWatch, is_kernel_clock_synchronised, kernel_says_synchronised

SYSFS_TTY = Path("/sys/class/tty")
LONGEST_LATENCY_MS = 2  # a driver's timer above this delays every reply by as much
WAITS, WAIT_S = 60, 0.004  # as long as those of a line
LATE_S = 0.001  # of a wait, in the middle: costs a line at 19200 bit/s a twentieth of its time
SYNCS, SYNC_BYTES = 5, 4096
SLOW_DISK_S = 0.25  # a start waits so long for the disk without a person noticing it


def latency_finding(port: str, where: str, *, sysfs: Path = SYSFS_TTY) -> Finding | None:
    """Return the finding about an adapter's latency timer; None when it has none."""
    timer = sysfs / Path(port).resolve().name / "device" / "latency_timer"
    try:
        milliseconds = int(timer.read_text("ascii"))
    except (OSError, ValueError):
        return None
    if milliseconds <= LONGEST_LATENCY_MS:
        return Finding(where, f"the adapter's latency timer is {milliseconds} ms")
    what = f"the adapter holds replies back for up to {milliseconds} ms"
    return Finding(where, what, Weight.WARNING, f"echo 1 > {timer}, or install the udev rule of deploy/")


def clock_finding(ask: Callable[[], bool | None] = kernel_says_synchronised) -> Finding:
    """Return whether the clock is synchronised: times in topics depend on it."""
    is_synchronised = ask()
    if is_synchronised is None:
        return Finding("clock", "whether it is synchronised is unknown here", Weight.NOTE)
    if is_synchronised:
        return Finding("clock", "is synchronised")
    what = "is not synchronised: time stamps may be wrong"
    return Finding("clock", what, Weight.WARNING, "install chrony, or switch systemd-timesyncd on")


def dated_finding(config: Config) -> Finding | None:
    """Return the finding about operators of `issued_at` alone on a machine whose clock proves nothing."""
    clients = dict.fromkeys(each.client for each in config.operators if each.freshness == BY_ISSUED_AT)
    doubt = ClockWatch(config.gateway.clock, ask=is_kernel_clock_synchronised).doubt()
    if not clients or doubt is None:
        return None
    return Finding(f"operator {', '.join(clients)}", dated_alone(doubt).text, Weight.WARNING)


def state_dir_finding(folder: Path) -> Finding:
    """Return whether the state directory, and all that is the gateway's in it, may be written."""
    there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
    is_made = there == folder.absolute()
    if not there.is_dir():
        return Finding("state_dir", f"{there} is no folder", Weight.ERROR, "choose another one")
    if not os.access(there, os.W_OK | os.X_OK | (os.R_OK if is_made else 0)):
        remedy = "chown it to the gateway's user" if is_made else f"make {folder} for the gateway's user"
        return Finding("state_dir", f"{there} may not be written by this user", Weight.ERROR, remedy)
    if not is_made:
        return Finding("state_dir", f"{folder} is not there yet: `run` makes it")
    foreign = [str(path) for path in _foreign_in(folder)]
    if foreign:
        more = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
        what = f"{foreign[0]}{more} in it may not be written by the gateway's user"
        return Finding("state_dir", what, Weight.ERROR, f"chown -R that user: {folder}")
    return Finding("state_dir", f"{folder} may be written")


def _foreign_in(folder: Path) -> Iterator[Path]:
    """Yield what this user may not write; for root, who may, what is not the folder's owner's."""
    owner = folder.stat().st_uid
    for path in backup.own_files(folder):
        with suppress(OSError):  # removed meanwhile
            is_another = os.geteuid() == 0 and path.lstat().st_uid != owner
            if is_another or (path.exists() and not os.access(path, os.R_OK | os.W_OK)):
                yield path


async def lateness_s() -> tuple[float, float]:
    """Return how late short waits end here, in the middle and at the worst; nothing may run beside it."""
    late_s = []
    for _ in range(WAITS):
        due_s = time.perf_counter() + WAIT_S
        await asyncio.sleep(WAIT_S)
        late_s.append(max(time.perf_counter() - due_s, 0.0))
    return sorted(late_s)[WAITS // 2], max(late_s)


def timers_finding(late_s: float, worst_s: float) -> Finding:
    """Return what waits cost that end so late, in the middle and at the worst."""
    late = f"waits end {late_s * 1e3:.1f} ms late, at most {worst_s * 1e3:.1f} ms"
    if late_s <= LATE_S:
        return Finding("timers", late)
    what = f"{late}: every transaction takes so much longer"
    return Finding("timers", what, Weight.WARNING, "see what else runs")


def disk_finding(sync_s: float | None) -> Finding | None:
    """Return what a disk costs that takes so long for a write; None where that is not known."""
    if sync_s is None:
        return None
    what = f"a write to state_dir is on the disk after {sync_s * 1e3:.0f} ms"
    if sync_s <= SLOW_DISK_S:
        return Finding("disk", what)
    is_refused = sync_s > INTEND_WITHIN_S
    what += ": starts are refused, not_stored" if is_refused else ": every start waits for it"
    remedy = "another disk, or nothing else that writes to this one"
    return Finding("disk", what, Weight.ERROR if is_refused else Weight.WARNING, remedy)


def sync_s(state_dir: Path) -> float | None:
    """Return the longest of some writes that wait for the disk, as the store's do; None: not possible."""
    path, took_s = state_dir / "doctor.probe", []  # one name: a doctor that was killed has left it
    try:
        with ExitStack() as ending, path.open("wb", buffering=0) as file:
            ending.callback(path.unlink)
            for _ in range(SYNCS):
                begun_s = time.perf_counter()
                file.write(bytes(SYNC_BYTES))
                os.fsync(file.fileno())
                took_s.append(time.perf_counter() - begun_s)
    except OSError:
        return None
    return max(took_s)
