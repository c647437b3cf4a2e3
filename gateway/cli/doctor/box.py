"""Measures this machine, and reports whether it is fast enough for the site; about a second."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from gateway.app.capacity import LineCapacity
from gateway.cli.box import BoxSpeed, capacity, demands_of, excess, measured
from gateway.cli.doctor.finding import DoctorFinding
from gateway.families.devices.findings import Weight
from gateway.starters.commands.execution import SLOW_DISK_S
from gateway.storage.ledger import INTEND_WITHIN_S

LATE_S = 0.001  # of a wait, in the middle: costs a line at 19200 bit/s a twentieth of its time
OTHERS_SHARE = 0.1  # of the processor, taken by other programs while it was measured


async def box_remarks(state_dir: Path, prospects: Iterable[LineCapacity]) -> list[DoctorFinding]:
    """Measure, store the measurement for `check`, and return what was found."""
    speed = await measured(state_dir)
    remarks = list(judged(speed, prospects))
    if trouble := speed.store(state_dir):
        remarks.append(DoctorFinding("machine", f"the measurement is not stored: {trouble}", Weight.NOTE))
    return remarks


def judged(speed: BoxSpeed, prospects: Iterable[LineCapacity]) -> Iterator[DoctorFinding]:
    """Give the findings about a measured machine."""
    demands = demands_of(prospects)
    trouble = excess(speed, demands)
    if trouble:
        yield DoctorFinding("machine", trouble, Weight.WARNING)
    else:
        yield DoctorFinding("machine", capacity(speed, demands))
    if 1.0 - speed.processor > OTHERS_SHARE:
        share = f"{1.0 - speed.processor:.0%} of a processor"
        what = f"{share} went to other programs meanwhile, or a quota held it back"
        yield DoctorFinding("machine", f"{what}; counted in as if they always did", Weight.NOTE)
    yield _timers(speed)
    if speed.sync_s is not None:
        yield _disk(speed.sync_s)


def _timers(speed: BoxSpeed) -> DoctorFinding:
    late = f"waits end {speed.timer_late_s * 1e3:.1f} ms late, at most {speed.timer_worst_s * 1e3:.1f} ms"
    if speed.timer_late_s <= LATE_S:
        return DoctorFinding("timers", late)
    return DoctorFinding(
        "timers", f"{late}: every transaction takes so much longer (see what else runs)", Weight.WARNING
    )


def _disk(sync_s: float) -> DoctorFinding:
    what = f"a write to state_dir is on the disk after {sync_s * 1e3:.0f} ms"
    if sync_s <= SLOW_DISK_S:
        return DoctorFinding("disk", what)
    hint = "another disk, or nothing else that writes to this one"
    if sync_s <= INTEND_WITHIN_S:
        return DoctorFinding("disk", f"{what}: every start waits for it ({hint})", Weight.WARNING)
    return DoctorFinding("disk", f"{what}: starts are refused, ledger_unavailable ({hint})", Weight.ERROR)
