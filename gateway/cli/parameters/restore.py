"""`parameters restore`: has the running gateway write a saved set to a starter, one `set` after the other.

It begins with what differs, and ends at the first setting that is not confirmed, with an account of what was
written and what is missing. Each `set` demands on fresh readings that the motor stands.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Collection

from gateway.cli.command import Progress
from gateway.cli.parameters.through_gateway import LiveStarter, variant_of
from gateway.contract import Note, Phase, ResultRecord
from gateway.errors import BrokerError, UsageError
from gateway.families import command
from gateway.starters.parameters.model import ParameterSet
from gateway.starters.parameters.restore_plan import (
    PlannedWrite,
    RestorePlan,
    groups_of,
    plan_restore,
    restore_codes,
)

CLEARED = Note("run_cleared").text


async def restore(live: LiveStarter, wanted: ParameterSet, args: Namespace) -> int:
    """Restore what differs; 0 when the starter then holds everything that can be written."""
    if wanted.family != live.profile.family:
        what = f"the file is of family {wanted.family}, {live.name} of {live.profile.family}"
        raise UsageError(f"{what}: choose another file")
    info = await live.info()
    if wanted.model and info.model and wanted.model != info.model and not args.other_model:
        what = f"the file was saved from {wanted.model!r}, this is {info.model!r}"
        raise UsageError(f"{what} (--other-model restores it nevertheless)")
    seen = await live.read(restore_codes(live.profile, wanted), Progress())
    plan = plan_restore(
        live.profile,
        variant_of(info),
        wanted=wanted,
        seen=seen.rows,
        with_sources=args.command_sources,
    )
    _show_plan(plan, live.profile.protected.command_sources, is_dry=args.dry_run)
    return 0 if args.dry_run or not plan.changes else await _write(live, plan)


async def _write(live: LiveStarter, plan: RestorePlan) -> int:
    """Write the changes in their order; whatever ends this, say what was written and what was not."""
    at_rest = dict.fromkeys(command.points_needed(live.profile, ("is_stopped",)), False)
    waiting, done, notes = list(groups_of(plan.changes)), list[PlannedWrite](), dict[str, None]()
    progress, failure = Progress(), ""
    try:
        while waiting and not failure:
            group = waiting.pop(0)
            progress.show(len(done) / len(plan.changes), f"writing {group[0].code}")
            failure = f"unknown: {_codes(group)} may have been written: look at the starter"
            try:
                result = await live.command("set", _arguments(group), expect=at_rest)
            except BrokerError:  # it was not even sent
                waiting.insert(0, group)
                failure = ""
                raise
            failure = _failure(group, result)
            if not failure:
                done += group
                notes |= dict.fromkeys([CLEARED] if CLEARED in result.text else [])
    finally:  # also when the connection is lost, and at Ctrl-C
        progress.clear()
        print(f"written and read back: {_codes(done) or 'nothing'}")
        for line in filter(None, (*notes, failure)):
            print(line)
        if waiting:
            print(f"not tried: {', '.join(map(_codes, waiting))}")
    return 1 if failure else 0


def _failure(group: Collection[PlannedWrite], result: ResultRecord) -> str:
    if result.phase is Phase.CONFIRMED:
        return ""
    return f"{result.phase.value}: {_codes(group)}: {result.text} [{result.code}]"


def _arguments(group: tuple[PlannedWrite, ...]) -> dict[str, object]:
    if len(group) == 1:
        return {"parameter": group[0].code, "value": group[0].value}
    return {"parameters": {change.code: change.value for change in group}}


def _codes(changes: Collection[PlannedWrite]) -> str:
    return ", ".join(change.code for change in changes)


def _show_plan(plan: RestorePlan, sources: Collection[str], *, is_dry: bool) -> None:
    for code, why in plan.left.items():
        hint = " (--command-sources restores it too)" if code in sources else ""
        print(f"left as it is: {code}: {why}{hint}")
    if not plan.changes:
        print(f"nothing {'else ' if plan.left else ''}to write: the starter holds the other settings already")
    for change in plan.changes:
        print(f"{'would write' if is_dry else 'to write'}: {change.text}")
