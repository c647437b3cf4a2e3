"""`parameters restore`: writes a saved set of parameters to a starter, or prints what it would write.

The gateway does not run meanwhile, since both need the port, so this command applies the gateway's own
rules from the files in its state directory. It writes nothing

1. while the starter is locked for maintenance (precautions);
2. when the device is not the starter that the gateway knows (identities);
3. when it is of another model than the file, unless --other-model is given;
4. when the line could not serve a watchdog that the file sets (watchdogs).

Afterwards it adds its writes to the count of memory writes, and stores the watchdogs for the next run.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from pathlib import Path

from gateway.cli.command import Progress
from gateway.cli.parameters.live import LiveStarter, read_with_progress
from gateway.contract import CommandError, Note, ResultCode
from gateway.errors import StoreError, UsageError
from gateway.families import Identity, reading
from gateway.line import new_precise_loop
from gateway.starters import FINGERPRINTS, KNOWN, WRITES, KnownWatchdogs, StarterSetup, mismatch_in
from gateway.starters.known_watchdogs import KNOWN_ROWS, WATCHDOGS
from gateway.starters.parameters.model import ParameterSet
from gateway.starters.parameters.offline_starter import OfflineStarter
from gateway.starters.parameters.restore import Restore, RestoreEnd
from gateway.starters.parameters.restore_plan import PlannedWrite, RestorePlan, plan_restore, restore_codes
from gateway.starters.policy.motor_history import LOCKS, MOTORS, MotorHistory
from gateway.starters.policy.preconditions import refusal
from gateway.store import STATE_FILE, Documents, backup, read_document, write_document
from gateway.system.clock import read_clocks


def identity_trouble(state_dir: Path, setup: StarterSetup, identity: Identity) -> str:
    """Return why this may be another starter; empty when it is the known one, or the first one seen here."""
    try:
        known = read_document(state_dir / STATE_FILE, FINGERPRINTS, KNOWN) or {}
    except StoreError as error:
        return f"whether it is the starter that the gateway knows is unknown: {error}"
    mismatch = mismatch_in(known.get(setup.name), setup, identity)
    return "" if mismatch is None else mismatch.event.text


def count_writes(state_dir: Path, starter: str, writes: int) -> str:
    """Add to the count of writes; return why that failed, empty when it was done.

    Where no gateway has ever run there is nothing to add to.
    """
    if not writes or not state_dir.is_dir():
        return ""
    path = state_dir / STATE_FILE
    try:
        totals = read_document(path, "writes", WRITES) or {}
        write_document(path, "writes", WRITES, {**totals, starter: totals.get(starter, 0) + writes})
    except StoreError as error:
        return f"writes to the memory of {starter} that are not counted: {writes}; {error}"
    return ""


def lock_trouble(state_dir: Path, starter: str) -> CommandError | None:
    """Return why nothing may be set in this starter; None when it is not locked."""
    logbook = MotorHistory([starter])
    try:
        stored = read_document(state_dir / STATE_FILE, LOCKS, MOTORS)
    except StoreError as error:
        return CommandError(ResultCode.LOCKED, "unreadable", starter=starter, error=error)
    if stored is not None:
        logbook.restore(stored, now_s=0.0, reading=read_clocks())
    lock = logbook.lock_of(starter)
    return None if lock is None else refusal(lock)


def known_watchdogs(state_dir: Path, starters: Iterable[StarterSetup]) -> KnownWatchdogs:
    """Return what the gateway knew last of the starters of a line."""
    watchdogs = KnownWatchdogs(Documents(path=state_dir / STATE_FILE))
    for setup in starters:
        watchdogs.add(setup)
    return watchdogs


def save_watchdogs(state_dir: Path, watchdogs: KnownWatchdogs) -> str:
    """Store these for the next run of the gateway; return why that failed, empty when it was done.

    Where no gateway has ever run there is nothing to add to.
    """
    if not state_dir.is_dir():
        return ""
    try:
        write_document(state_dir / STATE_FILE, WATCHDOGS, KNOWN_ROWS, watchdogs.known())
    except StoreError as error:
        return f"the next run does not know the watchdogs until it has read them: {error}"
    return ""


def run_restore(live: LiveStarter, wanted: ParameterSet, args: argparse.Namespace, progress: Progress) -> int:
    """Restore in real time and return the exit code."""
    if wanted.family != live.setup.profile.family:
        what = f"the file is of family {wanted.family}, {live.setup.name} of {live.setup.profile.family}"
        raise UsageError(f"{what}: choose another file")
    backup.keep_private(live.state_dir)
    with asyncio.Runner(loop_factory=new_precise_loop) as runner:
        options = {"is_other_model": args.other_model, "with_sources": args.command_sources}
        return runner.run(restore(live, wanted, progress, is_dry=args.dry_run, **options))


async def restore(
    live: LiveStarter,
    wanted: ParameterSet,
    progress: Progress,
    *,
    is_dry: bool = False,
    is_other_model: bool = False,
    with_sources: bool = False,
) -> int:
    """Restore what differs; 0 when the starter then holds everything that can be written."""
    name, watchdogs = live.setup.name, known_watchdogs(live.state_dir, live.neighbours)
    async with live.bench(watchdogs) as bench:
        _refuse(lock_trouble(live.state_dir, name), name, is_dry=is_dry)
        changed = identity_trouble(live.state_dir, live.setup, bench.identity)
        other = CommandError(ResultCode.IDENTITY_CHANGED, why=changed) if changed else None
        _refuse(other, name, is_dry=is_dry)
        _check_model(bench, wanted, is_other_model=is_other_model)
        reads = reading.bulk_reads(bench.profile, restore_codes(bench.profile, wanted))
        seen = (await read_with_progress(bench, reads, progress)).rows
        plan = plan_restore(bench.profile, bench.variant, wanted=wanted, seen=seen, with_sources=with_sources)
        _show_plan(plan, bench.profile.protected.command_sources, is_dry=is_dry)
        watchdogs.note(name, seen)
        _refuse(await _watchdog_trouble(watchdogs, name, plan), name, is_dry=is_dry)
        if is_dry or not plan.changes:
            return 0
        work = Restore(bench, plan, clock=live.clock)
        with suppress(NotImplementedError, ValueError):  # only the main thread's loop receives signals
            asyncio.get_running_loop().add_signal_handler(signal.SIGINT, work.interrupt)
        try:
            end = await work.run(_progress_shower(plan, progress))
        finally:
            trouble = count_writes(live.state_dir, name, work.writes)
            trouble = trouble or save_watchdogs(live.state_dir, watchdogs)
        code = _show_end(end, progress)
        if trouble:
            print(trouble)
        return code


def _refuse(trouble: CommandError | None, starter: str, *, is_dry: bool) -> None:
    """Raise CommandError for what the gateway would refuse; of a restore that writes nothing print it."""
    if trouble is not None and not is_dry:
        note = Note("nothing_written_to", starter=starter)
        raise CommandError(trouble.reason.noted(note)) from trouble
    if trouble is not None:
        print(f"would be refused: {trouble.text}")


async def _watchdog_trouble(
    watchdogs: KnownWatchdogs, starter: str, plan: RestorePlan
) -> CommandError | None:
    """Return why the line could not serve a watchdog that the set contains in time; None when it can."""
    try:
        await watchdogs.check(starter, {each.code: tuple(each.after.raw or ()) for each in plan.changes})
    except CommandError as error:
        return error
    return None


def _check_model(bench: OfflineStarter, wanted: ParameterSet, *, is_other_model: bool) -> None:
    here = bench.variant.model
    if wanted.model and here and wanted.model != here and not is_other_model:
        what = f"the file was saved from {wanted.model!r}, this is {here!r}"
        raise UsageError(f"{what} (--other-model restores it nevertheless)")


def _show_plan(plan: RestorePlan, sources: Collection[str], *, is_dry: bool) -> None:
    for code, why in plan.left.items():
        hint = " (--command-sources restores it too)" if code in sources else ""
        print(f"left as it is: {code}: {why}{hint}")
    if not plan.changes:
        print("nothing to write: the starter holds these settings already")
        return
    for change in plan.changes:
        print(f"{'would write' if is_dry else 'to write'}: {change.text}")


def _progress_shower(plan: RestorePlan, progress: Progress) -> Callable[[tuple[PlannedWrite, ...]], None]:
    """Return what shows how many of the changes are written, and how long the others will take."""
    loop = asyncio.get_running_loop()
    began_s, done = loop.time(), 0

    def show(group: tuple[PlannedWrite, ...]) -> None:
        nonlocal done
        left_s = (loop.time() - began_s) / done * (len(plan.changes) - done) if done else None
        progress.show(done / len(plan.changes), f"writing {group[0].code}", left_s=left_s)
        done += len(group)

    return show


def _show_end(end: RestoreEnd, progress: Progress) -> int:
    progress.end()
    written = ", ".join(change.code for change in end.done) or "nothing"
    print(f"written and read back: {written}")
    for note in end.notes:
        print(note)
    if end.failure is not None:
        codes = ", ".join(change.code for change in end.failed)
        print(f"{end.failure.phase.value}: {codes}: {end.failure.text} [{end.failure.code}]")
    if end.untried:
        print(f"not tried: {', '.join(change.code for change in end.untried)}")
    return 0 if end.failure is None and not end.untried else 1
