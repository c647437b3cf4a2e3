"""What a family's verbs read, demand, write and read back; nothing is written that no profile names.

`prepare` says what to read freshly and which rules must hold on it, `build` turns what was seen into steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gateway.families.arguments import check_names, switch
from gateway.families.configuration import build_configure, prepare_configure
from gateway.families.gather import reads_for, rows_of_points
from gateway.families.interlock import points_needed
from gateway.families.procedure import Expect, Preparation, Procedure, WriteStep
from gateway.families.refusals import refused
from gateway.families.schema import Command, Profile, Variant
from gateway.families.settings import build_read, build_set, prepare_read, prepare_set
from gateway.families.words import (
    Seen,
    command_requests,
    has_plain_word,
    run_row,
    stop_requests,
    take_back_run,
)
from gateway.modbus.pdu import Request

GENERIC_VERBS = ("read", "set")  # of every family, by the code of a row


def verbs(profile: Profile) -> tuple[str, ...]:
    """Return the verbs of this family."""
    return (*(name for name in profile.commands if not name.endswith(_OFF)), *GENERIC_VERBS)


def prepare(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any]) -> Preparation:
    """Return what must be read, and hold, before this command is built; CommandError when it makes no sense.

    A stop needs nothing, whatever comes with it.
    """
    _check_verb(profile, verb)
    match verb:
        case "stop":
            return Preparation(verb, reads=(), requires=())
        case "read":
            return prepare_read(profile, args)
        case "set":
            return prepare_set(profile, variant, args)
        case "configure":
            return prepare_configure(profile, variant, args)
        case _:
            return _prepare_command(profile, variant, verb, args)


def build(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return the steps of a command from the rows seen: freshly read, or for a stop what was last known."""
    _check_verb(profile, verb)
    match verb:
        case "stop":
            command = profile.commands[verb]
            return _procedure(
                profile, verb, command, stop_requests(profile, variant, command.writes, seen=seen)
            )
        case "read":
            return build_read(profile, args)
        case "set":
            return build_set(profile, variant, args, seen=seen)
        case "configure":
            return build_configure(profile, variant, args, seen=seen)
        case _:
            command = _command(profile, verb, args)
            requests = command_requests(profile, variant, command.writes, seen=seen)
            first = take_back_run(profile, variant, seen) if _may_wake(profile, command) else ()
            return _procedure(profile, verb, command, (*first, *requests))


_OFF = "_off"  # ends the name of the entry that a verb with `value` = false stands for
_VALUE = "value"


def _check_verb(profile: Profile, verb: str) -> None:
    known = verbs(profile)
    if verb not in known:
        raise refused("unknown_verb", f"{verb[:40]!r}; there are {', '.join(known)}")


def _prepare_command(profile: Profile, variant: Variant, verb: str, args: Mapping[str, Any]) -> Preparation:
    command = _command(profile, verb, args)
    codes = rows_of_points(profile, points_needed(profile, command.requires))
    if has_plain_word(command.writes) or _may_wake(profile, command):
        codes += (run_row(profile, variant), *rows_of_points(profile, ("running",)))
    return Preparation(verb, reads=reads_for(profile, codes), requires=command.requires)


def _command(profile: Profile, verb: str, args: Mapping[str, Any]) -> Command:
    """Return the entry of the profile that a verb and its arguments stand for."""
    command = profile.commands[verb]
    check_names(args, command.args)
    if command.args == (_VALUE,) and not switch(args, _VALUE):
        return profile.commands[verb + _OFF]
    return command


def _may_wake(profile: Profile, command: Command) -> bool:
    """Return whether a run command that still stands could start the motor after this one.

    A plain command word needs no stop before it: it is built without the run command (see `words`).
    """
    waking = (profile.commands.get(verb) for verb in ("reset", "general_enable"))
    return not has_plain_word(command.writes) and any(command is one for one in waking)


def _procedure(profile: Profile, verb: str, command: Command, requests: Sequence[Request]) -> Procedure:
    last = len(requests) - 1
    steps = tuple(
        WriteStep(request, is_silence_expected=command.restarts and place == last)
        for place, request in enumerate(requests)
    )
    return Procedure(verb, steps, verify=_verify(profile, verb, command))


def _verify(profile: Profile, verb: str, command: Command) -> Expect | None:
    if command.verify is None:
        return None
    point, becomes = command.verify.point, command.verify.becomes
    within_s = command.verify.within_s + (profile.timing.restart_s if command.restarts else 0.0)
    reads = reads_for(profile, rows_of_points(profile, (point,)))
    # A ramp says as much as its end, and only the SSW-06 is known to drop `running` at once (ssw06-es 4.2.2).
    ramp = {"start": "accelerating", "stop": "decelerating"}.get(verb)
    or_else = (Expect(reads, ramp, (True,), within_s),) if ramp else ()
    return Expect(reads, point, (becomes,), within_s, or_else=or_else)
