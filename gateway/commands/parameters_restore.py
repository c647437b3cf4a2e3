"""`parameters restore`: a saved set is put back, or it is told what that would change."""

from __future__ import annotations

import argparse
import asyncio
import signal
from collections.abc import Callable, Collection
from contextlib import suppress

from gateway.commands.kept_identity import identity_trouble
from gateway.commands.kept_lock import lock_trouble
from gateway.commands.kept_wear import count_writes
from gateway.commands.parameters_live import LiveStarter, read_with_progress
from gateway.commands.progress import Progress
from gateway.errors import CommandError, UsageError
from gateway.families.bulk import bulk_reads
from gateway.line.precise_selector import new_precise_loop
from gateway.starters.bench import Bench
from gateway.starters.parameter_set import ParameterSet
from gateway.starters.restore import Restore, RestoreEnd
from gateway.starters.restoring import Change, RestorePlan, plan_restore, restore_codes
from gateway.system.private_files import keep_private


def run_restore(live: LiveStarter, wanted: ParameterSet, args: argparse.Namespace, progress: Progress) -> int:
    """Restore in real time and return the exit code."""
    if wanted.family != live.setup.profile.family:
        what = f"the file is of family {wanted.family}, {live.setup.name} of {live.setup.profile.family}"
        raise UsageError(f"{what}: choose another file")
    keep_private(live.state_dir)
    with asyncio.Runner(loop_factory=new_precise_loop) as runner:
        return runner.run(
            restore(
                live,
                wanted,
                progress,
                is_dry=args.dry_run,
                is_other_model=args.other_model,
                with_sources=args.command_sources,
            )
        )


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
    async with live.bench() as bench:
        _check_lock(live, is_dry=is_dry)
        _check_identity(live, bench, is_dry=is_dry)
        _check_model(bench, wanted, is_other_model=is_other_model)
        reads = bulk_reads(bench.profile, restore_codes(bench.profile, wanted))
        seen = (await read_with_progress(bench, reads, progress)).rows
        plan = plan_restore(bench.profile, bench.variant, wanted=wanted, seen=seen, with_sources=with_sources)
        _show_plan(plan, bench.profile.protected.command_sources, is_dry=is_dry)
        if is_dry or not plan.changes:
            return 0
        work = Restore(bench, plan, clock=live.clock)
        with suppress(NotImplementedError, ValueError):  # only the main thread's loop hears signals
            asyncio.get_running_loop().add_signal_handler(signal.SIGINT, work.interrupt)
        try:
            end = await work.run(_teller(plan, progress))
        finally:
            trouble = count_writes(live.state_dir, live.setup.name, work.writes)
        code = _show_end(end, progress)
        if trouble:
            print(trouble)
        return code


def _check_lock(live: LiveStarter, *, is_dry: bool) -> None:
    """Let nothing be written while the starter is locked for maintenance: the gateway would refuse it too."""
    trouble = lock_trouble(live.state_dir, live.setup.name)
    if trouble is not None and not is_dry:
        raise CommandError(trouble.code, f"{live.setup.name}: {trouble.text}; nothing was written")
    if trouble is not None:
        print(f"would be refused: {trouble.text}")


def _check_identity(live: LiveStarter, bench: Bench, *, is_dry: bool) -> None:
    """Let nothing be written to a starter that the gateway itself would not command."""
    trouble = identity_trouble(live.state_dir, live.setup, bench.identity)
    if trouble and not is_dry:
        raise CommandError("identity_changed", f"{live.setup.name}: {trouble}; nothing was written")
    if trouble:
        print(f"would be refused: {trouble}")


def _check_model(bench: Bench, wanted: ParameterSet, *, is_other_model: bool) -> None:
    here = bench.variant.model
    if wanted.model and here and wanted.model != here and not is_other_model:
        what = f"the file was saved from {wanted.model!r}, this is {here!r}"
        raise UsageError(f"{what} (--other-model restores it nevertheless)")


def _show_plan(plan: RestorePlan, sources: Collection[str], *, is_dry: bool) -> None:
    for code, why in plan.left.items():
        mend = " (--command-sources restores it too)" if code in sources else ""
        print(f"left as it is: {code}: {why}{mend}")
    if not plan.changes:
        print("nothing to write: the starter holds these settings already")
        return
    for change in plan.changes:
        print(f"{'would write' if is_dry else 'to write'}: {change.text}")


def _teller(plan: RestorePlan, progress: Progress) -> Callable[[tuple[Change, ...]], None]:
    """Return what shows how many of the changes are written, and how long the others will take."""
    loop = asyncio.get_running_loop()
    began_s, done = loop.time(), 0

    def tell(group: tuple[Change, ...]) -> None:
        nonlocal done
        left_s = (loop.time() - began_s) / done * (len(plan.changes) - done) if done else None
        progress.show(done / len(plan.changes), f"writing {group[0].code}", left_s=left_s)
        done += len(group)

    return tell


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
