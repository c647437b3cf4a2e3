"""WEG SSW-06: as the SSW-07, with VB00 as a proof of who it is, and with adjusting modes [ssw06-es]."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from gateway.contract import CommandError, ResultCode
from gateway.families.devices.device import Device, Identity, Question, denied_by_name
from gateway.families.devices.findings import Remark, Settings, Weight, start
from gateway.families.devices.ssw07 import MODEL_ADDRESS, SSW06_MODEL, Ssw07Device
from gateway.families.profile.arguments import check_names, choice
from gateway.families.profile.procedure import Expect, Preparation, Procedure, Seen, WriteStep
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading import read_of, reads_for
from gateway.modbus import ReadHoldingRegisters, WriteRegister

_MODEL_ROW = "VB00"
_MODES = {"factory": 0, "P202": 1}  # bits of VB06 and VB07 [4.2.4, 4.2.5]
_SHOWN, _LEAVING = "VB06", "VB07"
_LEFT_WITHIN_S = 5.0  # beside the time of the restart


class Ssw06Device(Ssw07Device):
    """SSW-06."""

    product = re.compile(r"SSW[- ]?0?6(?![0-9])", re.IGNORECASE)  # "SSW-06 820.0A" [5.4.7]
    relays = ("P277", "P278", "P279")
    distinctive_rows = (_MODEL_ROW,)
    start_rows = (*Ssw07Device.source_rows, *relays, "P630", _SHOWN)

    def questions(self, profile: Profile) -> tuple[Question, ...]:
        """VB00, which every SSW-06 has, and FC43 [4.2.1, 5.4.7]."""
        model = ReadHoldingRegisters(MODEL_ADDRESS, 1)
        register = Question("register", model, is_always_there=True)
        return (register, *Device.questions(self, profile))

    def identity(self, profile: Profile, seen: Identity, answers: Mapping[str, Any]) -> Identity:
        """VB00 is 15 on every SSW-06: it proves one that is silent to FC43, and any other value denies it."""
        answer = answers.get("register")
        if answer is None:
            return denied_by_name(seen)
        reading = f"{seen.reason}; {_MODEL_ROW} is {answer[0]}"
        family, lacks = seen.family_seen, ""
        if answer[0] == SSW06_MODEL and family is None and seen.model is None:
            family = profile.family
        elif answer[0] != SSW06_MODEL and family in (None, profile.family):
            family = None
            lacks = reading = f"{reading} and should be {SSW06_MODEL}"
        return denied_by_name(replace(seen, family_seen=family, reason=reading, lacks=lacks))

    def is_like(self, seen: Seen) -> bool:
        """VB00 is 15 on every SSW-06 [4.2.1]."""
        return seen[_MODEL_ROW][0] == SSW06_MODEL

    def start_findings(self, settings: Settings) -> Iterator[Remark]:
        """See `Ssw07Device`, and 4.3."""
        yield from super().start_findings(settings)
        if settings.number(_SHOWN):
            what = "the motor cannot be run in an adjusting mode"
            yield start(Weight.ERROR, f"{what}: {settings.shown(_SHOWN)} (leave it at the starter)")

    def prepare_configure(self, profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
        """Return what to read before an adjusting mode is left."""
        _mode(args)
        return Preparation(reads=reads_for(profile, (_SHOWN,)), requires=())

    def build_configure(
        self, profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen
    ) -> Procedure:
        """Return the one write that leaves the mode; not_in_that_mode when VB06 was seen not to show it.

        In a mode the motor cannot be run. The device restarts when it leaves it: it may not answer the write,
        and is silent until it has started up [4.2.4, 4.2.5, 4.3].
        """
        mode = _mode(args)
        bit = 1 << _MODES[mode]
        if _SHOWN in seen and not seen[_SHOWN][0] & bit:
            raise CommandError(
                ResultCode.NOT_IN_THAT_MODE, row=_SHOWN, reading=seen[_SHOWN][0], bit=_MODES[mode], mode=mode
            )
        leave = WriteRegister(profile.parameters[_LEAVING].address, bit)
        within_s = profile.timing.restart_s + _LEFT_WITHIN_S
        left = Expect((read_of(profile, _SHOWN),), _SHOWN, is_one_of=((0,),), within_s=within_s, mask=bit)
        return Procedure((WriteStep(leave, is_silence_expected=True),), verify=left)


def _mode(args: Mapping[str, Any]) -> str:
    check_names(args, ("leave",))
    return choice(args, "leave", tuple(_MODES))


DEVICE = Ssw06Device()
