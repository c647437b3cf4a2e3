"""A run command that stands in a starter must not act by itself: run = 0 first, while the motor stands.

A fault, a general disable, a time in local mode or under another command source end the motion, but the
manuals do not say that they end the run command. It may still stand, also where its bit reads back as 0
(ssw900 S5.2), and whatever takes away what prevented it would then start the motor. So for every such
command of every family, in this order:

1. it is read that the motor stands (run = 0 would stop one that runs);
2. run = 0 is written, always, and must be acknowledged; where the bit can be read it must read 0, where the
   starter refuses to let it be read the motor must be seen to stand once more;
3. jog = 0 is written where there is a jog; a starter whose jog is not set up may refuse it;
4. what was commanded is written; where it changes the command source, run = 0 once more: a starter ignores
   the commands of a source that is not active (ssw06-es 4.2.3, ssw07 4.2.2), the first run = 0 included;
5. it is read back, and that the motor still stands; when either is not seen, the starter is stopped.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import reduce
from operator import or_

from gateway.contract import CommandError, Note, ResultCode
from gateway.families.command.control_word import (
    command_bit,
    flags_of,
    has_plain_word,
    missing_since,
    run_row,
    stop_requests,
    word_codes,
)
from gateway.families.command.interlock import local_source, points_needed
from gateway.families.profile.procedure import Expect, Preparation, Procedure, Seen, WriteStep
from gateway.families.profile.schema import Profile, Variant, Write
from gateway.families.reading import reads_for, rows_of_points
from gateway.modbus import Request

STANDSTILL = "is_stopped"
CLEARED_WITHIN_S = 1.0  # until the run command reads 0

# Entries of a profile's commands that ask for motion, or for its end. All others may let a command act that
# stands.
_MOTION = ("start", "stop", "jog", "jog_off", "general_enable_off", "output")
CHANGES_SOURCE = ("local_remote", "local_remote_off")  # they choose who commands the motor


def wakes(entry: str) -> bool:
    """Return whether an entry of a profile's commands may let a run command act that stands."""
    return entry not in _MOTION


def with_standstill(profile: Profile, preparation: Preparation, codes: Iterable[str] = ()) -> Preparation:
    """Return a preparation that also demands that the motor stands, and reads these rows."""
    requires = tuple(dict.fromkeys((*preparation.requires, STANDSTILL)))
    needed = rows_of_points(profile, points_needed(profile, requires))
    read = (code for each in preparation.reads for code in each.codes)
    return replace(preparation, reads=reads_for(profile, (*read, *codes, *needed)), requires=requires)


def words_needed(profile: Profile, variant: Variant, *, is_source: bool) -> tuple[str, ...]:
    """Return the rows of the command words in which run = 0 is written; none where run has its own."""
    if not has_plain_word(profile.commands["stop"].writes):
        return ()
    return word_codes(profile, _scope(variant, is_source=is_source))


def with_run_cleared(
    profile: Profile, variant: Variant, procedure: Procedure, *, seen: Seen, is_source: bool
) -> Procedure:
    """Return a procedure with run = 0 before its writes; CommandError when the motor was seen to run.

    `is_source`: it chooses who commands the motor.
    """
    if flags_of(profile, seen).get("moving"):
        raise CommandError(ResultCode.MOTOR_RUNNING, "clearing")
    off = _run_off(profile, _scope(variant, is_source=is_source), seen)
    # The SSW900 resets the run command of a source that is not active (S5.2); a whole word would choose
    # local or remote once more.
    has_last = is_source and not has_plain_word(profile.commands["stop"].writes)
    again = [WriteStep(step.request, may_be_refused=True) for step in off] if has_last else []
    return replace(
        procedure,
        steps=(*off, *procedure.steps, *again),
        verify=_and_standing(profile, procedure.verify),
        is_run_cleared=True,
        notes=(Note("run_cleared"), *procedure.notes),
        is_source=is_source,
    )


def _scope(variant: Variant, *, is_source: bool) -> Variant:
    """Return whose command words are cleared: where the source changes, those of both slots."""
    return replace(variant, slot=None) if is_source else variant


def _word_rows(profile: Profile, variant: Variant) -> tuple[str, ...]:
    """Return the rows whose bit 0 is the run command, as far as it can be read back."""
    return word_codes(profile, variant) or (run_row(profile, variant),)


def released(profile: Profile, variant: Variant, seen: Seen) -> Expect:
    """Return what shows that no motion command is left: run and jog read 0 while the starter obeys this line.

    That is in remote mode, and in local mode where the row that says so (`local_source`) was among `seen`.
    """
    rows = _word_rows(profile, variant)
    source = local_source(profile, variant)
    local = (source,) if source is not None and source[0] in seen else ()  # it was decided in local mode
    codes = tuple(code for code, _ in local)
    reads = reads_for(profile, (*rows, *rows_of_points(profile, ("remote",)), *codes))
    bits = reduce(or_, (command_bit(profile, name) for name in ("start", "jog") if name in profile.commands))
    first, *others = (Expect(reads, row, ((0,),), CLEARED_WITHIN_S, mask=bits) for row in rows)
    obeys = tuple(Expect(reads, code, ((number,),), CLEARED_WITHIN_S) for code, number in local)
    is_remote = Expect(reads, "remote", (True,), CLEARED_WITHIN_S, or_else=obeys)
    return replace(first, also=(*others, is_remote))


def _run_off(profile: Profile, variant: Variant, seen: Seen) -> tuple[WriteStep, ...]:
    """Return the steps that take the run command back, and the jog command."""
    requests = stop_requests(profile, variant, profile.commands["stop"].writes, seen=seen)
    rows = _word_rows(profile, variant)
    reads = reads_for(profile, rows)
    run = profile.command_bits.run
    first, *others = (Expect(reads, row, ((0,),), CLEARED_WITHIN_S, mask=run) for row in rows)
    *before, last = (_strict(profile, request, seen) for request in requests)
    steps = (*before, replace(last, then=replace(first, also=tuple(others))))
    taken_back = jog_off(profile, variant, seen)
    return (*steps, *(WriteStep(request, may_be_refused=True) for request in taken_back))


def jog_off(profile: Profile, variant: Variant, seen: Seen) -> Sequence[Request]:
    """Return what takes a jog back; nothing where the stop does so, or the starter has no jog."""
    command = profile.commands.get("jog_off")
    if command is None or has_plain_word(command.writes) or missing_since(profile, variant, command):
        return ()  # a plain word takes the jog back with the run command
    return stop_requests(profile, variant, command.writes, seen=seen)


def _strict(profile: Profile, request: Request, seen: Seen) -> WriteStep:
    """Return run = 0 as a step: when it is not taken, nothing that follows is written.

    A starter that may refuse it cannot be started either (the profile says when); it is read below that the
    run command is 0.
    """
    condition = profile.commands["stop"].refused_unless
    is_barred = flags_of(profile, seen).get(condition) is False
    return WriteStep(request, is_run_off=True, may_be_refused=is_barred)


def _and_standing(profile: Profile, verify: Expect | None) -> Expect | None:
    """Return an expectation that also demands that the motor does not run, nor is about to."""
    if verify is None:
        return None
    codes = [code for read in verify.reads for code in read.codes]
    names = ("running", *profile.state.starting)
    reads = reads_for(profile, (*codes, *rows_of_points(profile, names)))
    standing = (Expect(reads, name, (False,), verify.within_s) for name in names)
    return replace(verify, reads=reads, also=(*verify.also, *standing))


def writes_of(profile: Profile, entry: str) -> tuple[Write, ...]:
    """Return what an entry writes; of a plain command word never its run and jog bits."""
    writes = profile.commands[entry].writes
    if not wakes(entry) or not has_plain_word(writes):
        return writes
    off = profile.command_bits.run | profile.command_bits.jog
    return tuple(write.model_copy(update={"clear_bits": write.clear_bits | off}) for write in writes)
