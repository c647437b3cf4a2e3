"""Intecma SST: identified by its registers, initialised before it can be started [sst-intecma].

A configuration register written outside the configuration mode stops the motor, and so does entering the mode
(coil table): the initialisation sequence is the only way in which these registers may be written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from gateway.contract import CommandError, ResultCode
from gateway.families.devices.device import Device, Identity, Question, alarm, unnumbered
from gateway.families.devices.findings import Remark, Settings, Topic, Watchdog, Weight, start, unread
from gateway.families.profile.parameters import find, settable_words, write_request
from gateway.families.profile.procedure import Expect, Preparation, Procedure, Seen, WriteStep
from gateway.families.profile.rows import Alarm, Type
from gateway.families.profile.schema import Profile, Variant
from gateway.families.profile.word_types import serial_of, text_of, to_text, version_of
from gateway.families.reading import holds, read_back, read_of, reads_for
from gateway.modbus import ReadInputRegisters, WriteCoil

_MODEL = "R0"
_MODELS = {330: "SST330i", 360: "SST360i", 130: "SST130i"}  # register 0
_MODE, _COMPLETE, _USB, _INPUTS, _READY = "COIL2", "COIL5", "COIL7", "COIL8", "COIL26"
_ERRORS = range(10, 22)  # coils
_STOP_AFTER, _RESTART_AFTER = "R41", "R42"
_MODE_WITHIN_S = 2.0  # until coil 2 shows the configuration mode
_FLASH_WITHIN_S = 5.0  # until coil 5 shows that the configuration is in flash (NOTES)


class SstDevice(Device):
    """SST330i, SST360i, SST130i."""

    names = re.compile(r"SST *(?:330|360|130)i?(?![0-9])", re.IGNORECASE)
    distinctive_rows = (_MODEL,)
    start_rows = (_COMPLETE, _USB, _INPUTS, _READY)
    watchdog_rows = (_STOP_AFTER, _RESTART_AFTER)

    def questions(self, profile: Profile) -> tuple[Question, ...]:
        """Model, versions and serial number; the name, which old firmware refuses (erratum E-25)."""
        model = Question("model", ReadInputRegisters(0, 12), is_always_there=True)
        return model, Question("name", ReadInputRegisters(22, 8))

    def identity(self, profile: Profile, seen: Identity, answers: Mapping[str, Any]) -> Identity:
        """Register 0 is the number of a model."""
        registers = answers.get("model")
        if registers is None:
            return Identity(reason="registers 0-11 are not answered")
        model = _MODELS.get(registers[0])
        if model is None:
            return Identity(reason=f"register 0 is {registers[0]}, no model number of an SST")
        return Identity(
            family_seen=profile.family,
            model=text_of(answers.get("name") or (), profile.joins["name"].begins) or model,
            firmware=version_of(registers[2:4]),
            hardware=to_text(Type.VERSION_LOW, registers[1:2]),
            serial=serial_of(registers[8:12]),
            reason=f"register 0 is {registers[0]}",
        )

    def is_like(self, seen: Seen) -> bool:
        """Register 0 is the number of a model."""
        return seen[_MODEL][0] in _MODELS

    def alarms(self, profile: Profile, points: Mapping[str, Any]) -> list[Alarm]:
        """Coil 9 says that there is an error, coils 10-21 which one."""
        found = [alarm(profile, f"coil{coil}", "fault") for coil in _ERRORS if points.get(f"coil{coil}")]
        return found or ([unnumbered(profile, "fault")] if points.get("fault") else [])

    def start_findings(self, settings: Settings) -> Iterator[Remark]:
        """Coils 5, 7, 8, 26; registers 41, 42 [coil table, NOTES]."""
        yield from unread(settings, self.start_rows, Topic.START)
        if settings.number(_USB):
            yield start(Weight.ERROR, "USB controls the starter (coil 7): it refuses every write")
        if settings.number(_INPUTS):
            what = "the parallel inputs control the starter (coil 8): it refuses every write"
            yield start(Weight.ERROR, what)
        if settings.number(_COMPLETE) == 0:
            what = "it is not initialised (coil 5 = 0): send `configure` before a start"
            yield start(Weight.ERROR, what)
        if settings.number(_READY) == 0:
            what = "it is not ready for a start (coil 26 = 0)"
            yield start(
                Weight.ERROR, f"{what}: mains and power source are not detected, or an error is present"
            )
        stop_s, restart_s = settings.number(_STOP_AFTER), settings.number(_RESTART_AFTER)
        if stop_s and restart_s and restart_s <= stop_s:
            what = "it would restart before it stops the motor, which the manual does not describe"
            shown = f"{settings.shown(_RESTART_AFTER)} is not above {settings.shown(_STOP_AFTER)}"
            yield Remark(Topic.WATCHDOG, Weight.WARNING, f"{what}: {shown}")

    def watchdogs(self, settings: Settings) -> Iterator[Watchdog]:
        """Registers 41 and 42; any request restarts both [register table, NOTES]."""
        for code, does in (
            (_STOP_AFTER, "stops the motor"),
            (_RESTART_AFTER, "stops the motor and restarts itself"),
        ):
            after_s = settings.number(code)
            if after_s:
                yield Watchdog(code, float(after_s), does, is_felt=True)

    def prepare_configure(self, profile: Profile, variant: Variant, args: Mapping[str, Any]) -> Preparation:
        """Return what to read before initialisation; `args` are new values by register, or none.

        That the motor must stand is said in families/command/run_command.py.
        """
        reads = reads_for(profile, (_USB, _INPUTS, _COMPLETE, *_wanted(profile, variant, args)))
        return Preparation(reads=reads, requires=("serial_controls",))

    def build_configure(
        self, profile: Profile, variant: Variant, args: Mapping[str, Any], *, seen: Seen
    ) -> Procedure:
        """Return the whole sequence, also when no register differs: it releases the start.

        Only registers that differ from what was seen are written (each goes to flash), one by one: what the
        text says of FC16 contradicts the Modbus specification. Leaving the mode counts as one write of the
        flash, whether something differs or not.
        """
        pairs = [(profile.parameters[code], words) for code, words in _wanted(profile, variant, args).items()]
        differing = [(row, words) for row, words in pairs if not holds(row, words, seen)]
        complete = _is_set(profile, _COMPLETE, within_s=_FLASH_WITHIN_S)
        mode = profile.parameters[_MODE].address
        enter, leave = WriteCoil(mode, is_on=True), WriteCoil(mode, is_on=False)
        steps = (
            WriteStep(enter, then=_is_set(profile, _MODE, within_s=_MODE_WITHIN_S)),
            *(WriteStep(write_request(profile, row, words)) for row, words in differing),
            WriteStep(leave, then=complete),
        )
        verify = read_back(profile, pairs) if pairs else complete
        return Procedure(steps, verify=verify, abandon=(leave,), wears=1)


def _wanted(profile: Profile, variant: Variant, args: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    wanted: dict[str, tuple[int, ...]] = {}
    for code, value in args.items():
        row = find(profile, code)
        if row.code in wanted:
            raise CommandError(ResultCode.BAD_ARGUMENTS, "twice", row=row.code)
        if not row.is_configuration:
            raise CommandError(ResultCode.BAD_ARGUMENTS, "not_configuration", row=row.code)
        wanted[row.code] = settable_words(profile, variant, row, value)
    return wanted


def _is_set(profile: Profile, code: str, *, within_s: float) -> Expect:
    return Expect((read_of(profile, code),), name=code, is_one_of=((1,),), within_s=within_s)


DEVICE = SstDevice()
