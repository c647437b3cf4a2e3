"""The readings, demands, writes and read-backs of a family's verbs; nothing is written that no profile names.

`prepare` says what to read freshly and which rules must hold on it, `build` makes steps of what was seen,
`verification` says how a command is seen to have acted: an accepted write is not an executed command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from gateway.contract import CommandError, Note, ResultCode
from gateway.families.command import run_command
from gateway.families.command.control_word import (
    command_requests,
    has_plain_word,
    is_jogging,
    missing_since,
    run_row,
    stop_requests,
    word_codes,
)
from gateway.families.command.interlock import check_set_to_serial, local_source, points_needed
from gateway.families.command.outputs import build_output, prepare_output
from gateway.families.command.settings import build_read, build_set, prepare_read, prepare_set, rows_set
from gateway.families.devices import device_of
from gateway.families.profile.arguments import check_names, choice, switch
from gateway.families.profile.decode import is_there
from gateway.families.profile.procedure import (
    Expect,
    Preparation,
    Procedure,
    Seen,
    TakeBack,
    WriteStep,
)
from gateway.families.profile.schema import Command, Profile, Variant
from gateway.families.profile.state import moving
from gateway.families.reading import reads_for, rows_of_points, with_rows
from gateway.modbus import Request


def verification(profile: Profile, variant: Variant, verb: str, command: Command) -> Expect | None:
    """Return what must be read after the command; None when there is nothing to look at."""
    if command.verify is None:
        return None
    point, becomes = command.verify.point, command.verify.becomes
    within_s = command.verify.within_s + (profile.timing.restart_s if command.restarts else 0.0)
    names = [point]
    if verb == "stop":
        names += [*_other_motions(profile, variant), *profile.state.starting]
    reads = reads_for(profile, rows_of_points(profile, names))
    # A ramp says as much as its end, and only the SSW-06 is known to drop `running` at once (ssw06-es 4.2.2).
    # So does the time before a start, which may be set to a quarter of an hour (ssw900 S5.1, C5.7.1).
    signs = {"start": ("accelerating", *profile.state.starting), "stop": ("decelerating",)}.get(verb, ())
    or_else = tuple(Expect(reads, each, (True,), within_s) for each in signs if each in profile.points)
    also = tuple(Expect(reads, name, (False,), within_s) for name in names[1:])
    return Expect(reads, point, (becomes,), within_s, or_else=or_else, also=also)


def _other_motions(profile: Profile, variant: Variant) -> list[str]:
    """Return the other motions that a stop has to end: a jog, and a reversal, which runs again by itself."""
    names = [each for each in ("jog", "reversing") if each in profile.points]
    return [each for each in names if _is_there(profile, variant, each)]


GENERIC_VERBS = ("read", "set")  # of every family, by the code of a row


def verbs(profile: Profile) -> tuple[str, ...]:
    """Return the verbs of this family."""
    return (*(name for name in profile.commands if not name.endswith(_PARTS)), *GENERIC_VERBS)


def prepare(
    profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any], *, is_local: bool = False
) -> Preparation:
    """Return what must be read, and hold, before this command is built; CommandError when it makes no sense.

    A stop needs nothing, whatever comes with it. `is_local`: the starter was last seen in local mode, so that
    the row which may give the commands there to this line is read as well.
    """
    _check_verb(profile, verb)
    preparation = _prepare(profile, variant, verb, args)
    source = local_source(profile, variant) if is_local else None
    if source is not None and _REMOTE in preparation.requires:
        preparation = replace(preparation, reads=with_rows(profile, preparation.reads, (source[0],)))
    wakes, is_source = _effects(profile, variant, verb, args)
    if not wakes:
        return preparation
    rows = run_command.words_needed(profile, variant, is_source=is_source)
    return run_command.with_standstill(profile, preparation, rows)


def _prepare(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any]) -> Preparation:
    match verb:
        case "stop":
            return Preparation(reads=(), requires=())
        case "read":
            return prepare_read(profile, args)
        case "set":
            return prepare_set(profile, variant, args)
        case "output":
            return prepare_output(profile, args)
        case "configure":
            return device_of(profile).prepare_configure(profile, variant, args)
        case _:
            return _prepare_command(profile, variant, verb, args)


def build(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return the steps of a command from the rows seen: freshly read, or for a stop what was last known."""
    _check_verb(profile, verb)
    procedure = _build(profile, variant, verb, args, seen=seen)
    wakes, is_source = _effects(profile, variant, verb, args)
    if not procedure.steps or not wakes:
        return procedure
    return run_command.with_run_cleared(profile, variant, procedure, seen=seen, is_source=is_source)


def _build(
    profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any], *, seen: Seen
) -> Procedure:
    match verb:
        case "stop":
            return _build_command(profile, variant, verb, verb, seen=seen)
        case "read":
            return build_read(profile, args)
        case "set":
            return build_set(profile, variant, args, seen=seen)
        case "output":
            return build_output(profile, args, seen=seen)
        case "configure":
            return device_of(profile).build_configure(profile, variant, args, seen=seen)
        case _:
            return _build_command(profile, variant, verb, _entry(profile, variant, verb, args), seen=seen)


# Endings of the entries that a verb stands for with `value` = false, or with a flag.
_OFF, _WHOLE = "_off", "_whole"
_PARTS = (_OFF, _WHOLE)
_VALUE = "value"
_REMOTE = "remote"  # the rule and its point

# Entries that take a motion command back: built whatever is unknown, forbidden by nothing.
_RELEASES = ("stop", "jog_off")
TAKEN_BACK = ("start", "jog")  # verbs, and the entries that they stand for
_AT_REST_WITHIN_S = 2.0  # lost replies are made up for


def _effects(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any]) -> tuple[bool, bool]:
    """Return whether a command may let a run command act that stands, and whether it chooses the source."""
    if verb in ("stop", "read"):
        return False, False
    if verb == "set":
        rows = rows_set(profile, args)
        is_source = any(profile.protected.wakes(row.code) for row in rows)
        return is_source or any(row.is_configuration for row in rows), is_source
    entry = verb if verb in ("output", "configure") else _entry(profile, variant, verb, args)
    return run_command.wakes(entry), entry in run_command.CHANGES_SOURCE


def _check_verb(profile: Profile, verb: str) -> None:
    known = verbs(profile)
    if verb not in known:
        raise CommandError(ResultCode.UNKNOWN_VERB, "family", verb=verb[:40], verbs=", ".join(known))


def _entry(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any]) -> str:
    command = profile.commands[verb]
    check_names(args, command.args, command.flags)
    flags = [flag for flag in command.flags if flag in args and switch(args, flag)]
    name = "_".join((verb, *flags))
    if command.args == (_VALUE,) and not _is_first(command, args):
        name += _OFF
    since = "" if name in _RELEASES else missing_since(profile, variant, profile.commands[name])
    if since:
        raise CommandError(ResultCode.NOT_IN_FIRMWARE, verb=verb, since=since, firmware=variant.firmware)
    return name


def _is_first(command: Command, args: Mapping[str, Any]) -> bool:
    if command.values == ("true", "false"):
        return switch(args, _VALUE)
    return choice(args, _VALUE, command.values) == command.values[0]


def _prepare_command(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any]) -> Preparation:
    name = _entry(profile, variant, verb, args)
    command = profile.commands[name]
    codes = rows_of_points(profile, points_needed(profile, command.requires))
    if has_plain_word(command.writes) and name in _RELEASES:
        codes += (*word_codes(profile, variant), *rows_of_points(profile, ("running",)))
    elif has_plain_word(command.writes):
        codes += (run_row(profile, variant), *rows_of_points(profile, ("running",)))
    reads = reads_for(profile, (*codes, *command.needs, *command.ceilings))
    return Preparation(reads=reads, requires=command.requires)


def _build_command(profile: Profile, variant: Variant, verb: str, name: str, *, seen: Seen) -> Procedure:
    command = profile.commands[name]
    check_set_to_serial(profile, command.needs, seen)
    _check_ceilings(profile, variant, command, seen)
    requests = _requests(profile, variant, name, seen=seen)
    last = len(requests) - 1
    steps = tuple(
        WriteStep(request, is_silence_expected=command.restarts and place == last)
        for place, request in enumerate(requests)
    )
    notes = (Note("family", note=command.note),) if command.note else ()
    procedure = Procedure(steps, verify=verification(profile, variant, verb, command), notes=notes)
    if name not in TAKEN_BACK:
        return procedure
    return replace(procedure, take_back=_take_back(profile, variant, seen))


def _take_back(profile: Profile, variant: Variant, seen: Seen) -> TakeBack:
    """Return when a start or a jog is seen not to act, and when it is seen to be taken back."""
    names = [name for name in moving(profile) if _is_there(profile, variant, name)]
    reads = reads_for(profile, rows_of_points(profile, names))
    first, *others = (Expect(reads, name, (False,), _AT_REST_WITHIN_S) for name in names)
    released = run_command.released(profile, variant, seen)
    return TakeBack(released, at_rest=replace(first, also=tuple(others)))


def _is_there(profile: Profile, variant: Variant, name: str) -> bool:
    return name in profile.points and is_there(profile, variant, profile.points[name].source)


def stop(profile: Profile, variant: Variant, *, seen: Seen, with_jog: bool) -> Procedure:
    """Return what stops the motor, whatever is unknown; `with_jog`: and a jog that was not seen."""
    procedure = build(profile, variant, "stop", {}, seen=seen)
    if not with_jog:
        return procedure
    written = {step.request for step in procedure.steps}
    jog_off = (each for each in run_command.jog_off(profile, variant, seen) if each not in written)
    return replace(
        procedure, steps=(*procedure.steps, *(WriteStep(each, may_be_refused=True) for each in jog_off))
    )


def _requests(profile: Profile, variant: Variant, name: str, *, seen: Seen) -> Sequence[Request]:
    writes = run_command.writes_of(profile, name)
    if name in _RELEASES:
        requests = stop_requests(profile, variant, writes, seen=seen)
        if name == "stop" and not has_plain_word(writes) and is_jogging(profile, seen):
            jog_off = profile.commands["jog_off"].writes  # a stop by ramp does not take a jog back
            requests += stop_requests(profile, variant, jog_off, seen=seen)
        return requests
    return command_requests(profile, variant, writes, seen=seen)


def _check_ceilings(profile: Profile, variant: Variant, command: Command, seen: Seen) -> None:
    """Raise the ceiling's refusal when a row was seen to read more, on a model that has the reading."""
    model = (variant.model or "").casefold()
    for code, ceiling in command.ceilings.items():
        is_of_model = not model or any(model.startswith(one.casefold()) for one in ceiling.models)
        reading = seen.get(code, (0,))[0] if is_of_model and is_there(profile, variant, code) else 0
        if reading > ceiling.most:
            raise CommandError(
                ceiling.refusal, row=code, reading=reading, unit=ceiling.unit, most=ceiling.most
            )
