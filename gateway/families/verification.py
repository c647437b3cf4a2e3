"""How a command is seen to have acted: an accepted write is not an executed command."""

from __future__ import annotations

from gateway.families.decode import is_known
from gateway.families.gather import reads_for, rows_of_points
from gateway.families.procedure import Expect
from gateway.families.schema import Command, Profile, Variant
from gateway.families.state import STARTING


def verification(profile: Profile, variant: Variant, verb: str, command: Command) -> Expect | None:
    """Return what must be read after the command; None when there is nothing to look at."""
    if command.verify is None:
        return None
    point, becomes = command.verify.point, command.verify.becomes
    within_s = command.verify.within_s + (profile.timing.restart_s if command.restarts else 0.0)
    names = [point, *([_JOG] if verb == "stop" and _has_jog(profile, variant) else [])]
    reads = reads_for(profile, rows_of_points(profile, names))
    # A ramp says as much as its end, and only the SSW-06 is known to drop `running` at once (ssw06-es 4.2.2).
    # So does the time before a start, which may be set to a quarter of an hour (ssw900 S5.1, C5.7.1).
    telling = {"start": ("accelerating", *STARTING), "stop": ("decelerating",)}.get(verb, ())
    or_else = tuple(Expect(reads, each, (True,), within_s) for each in telling if each in profile.points)
    also = tuple(Expect(reads, name, (False,), within_s) for name in names[1:])
    return Expect(reads, point, (becomes,), within_s, or_else=or_else, also=also)


_JOG = "jog"  # a motor that jogs does not "run", and yet it turns


def _has_jog(profile: Profile, variant: Variant) -> bool:
    return _JOG in profile.points and is_known(profile.points[_JOG].since_firmware, variant)
