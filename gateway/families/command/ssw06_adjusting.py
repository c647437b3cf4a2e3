"""The SSW-06's way out of its adjusting modes, in which its motor cannot be run (ssw06-es 4.2.4, 4.2.5, 4.3).

The device restarts when it leaves a mode: it may not answer the write, and is silent until it has started up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.families.command.arguments import check_names, choice
from gateway.families.command.control_word import Seen
from gateway.families.command.writable import read_of
from gateway.families.profile.procedure import Expect, Preparation, Procedure, WriteStep
from gateway.families.profile.refusals import refused
from gateway.families.profile.schema import Profile
from gateway.families.reading.bulk import reads_for
from gateway.modbus.writes import WriteRegister

LEFT_WITHIN_S = 5.0  # beside the time of the restart

MODES = {"factory": 0, "P202": 1}  # bits of VB06 and VB07


def prepare_leaving(profile: Profile, args: Mapping[str, Any]) -> Preparation:
    """Return what to read before a mode is left."""
    _mode(args)
    return Preparation("configure", reads=reads_for(profile, (_SHOWN,)), requires=())


def build_leaving(profile: Profile, args: Mapping[str, Any], *, seen: Seen) -> Procedure:
    """Return the one write that leaves the mode; not_in_that_mode when VB06 was seen not to show it."""
    mode = _mode(args)
    bit = 1 << MODES[mode]
    if _SHOWN in seen and not seen[_SHOWN][0] & bit:
        raise refused("not_in_that_mode", f"VB06 is {seen[_SHOWN][0]}, without bit {MODES[mode]} ({mode})")
    leave = WriteRegister(profile.parameters[_LEAVING].address, bit)
    within_s = profile.timing.restart_s + LEFT_WITHIN_S
    left = Expect((read_of(profile, _SHOWN),), _SHOWN, is_one_of=((0,),), within_s=within_s, mask=bit)
    return Procedure("configure", (WriteStep(leave, is_silence_expected=True),), verify=left)


_SHOWN, _LEAVING = "VB06", "VB07"


def _mode(args: Mapping[str, Any]) -> str:
    check_names(args, ("leave",))
    return choice(args, "leave", tuple(MODES))
