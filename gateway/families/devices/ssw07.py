"""WEG SSW-07 and SSW-08, and what the SSW-06 shares with them: P2xx, P3xx and E28 [ssw07, ssw06-es]."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from gateway.families.devices.device import Device, Identity, Question, denied_by_name
from gateway.families.devices.findings import (
    Remark,
    Settings,
    Topic,
    Watchdog,
    Weight,
    is_one_of,
    sources,
    start,
    unread,
)
from gateway.families.profile.schema import Profile
from gateway.modbus import ReadHoldingRegisters

MODEL_ADDRESS, SSW06_MODEL = 5000, 15  # VB00 of every SSW-06 [ssw06-es 4.2.1]
_SERIAL = 2  # P229, P230 [ssw06-es 2.6, 2.7; ssw07 2.6, 2.7]
_MODE_BY_SERIAL = (5, 6)  # P220 [ssw06-es 2.5; ssw07 2.5]
_RAMP_STOP, _DISABLE, _TO_LOCAL, _FATAL = 1, 2, 3, 5  # P313; 5 on the SSW-06 only [ssw06-es 2.3; ssw07 2.3]


class Ssw07Device(Device):
    """SSW-07 or SSW-08; what the SSW-08 says to FC43 is not stated [ssw07 5.4.7]."""

    product = re.compile(r"SSW[- ]?0?[78](?![0-9])", re.IGNORECASE)  # "SSW-07 85.0A"
    source_rows = ("P220", "P229", "P230")
    watchdog_rows = ("P314", "P313")
    watchdog_action = "P313"
    relays: tuple[str, ...] = ("P277", "P278")
    start_rows: tuple[str, ...] = (*source_rows, *relays, "P630")

    def questions(self, profile: Profile) -> tuple[Question, ...]:
        """VB01, which every one has, VB00, and FC43, which an SSW-08 may refuse [4.2.1, 5.3.1, 5.4.7].

        VB00 is not described for these (erratum B-05): only 15 says something.
        """
        status = ReadHoldingRegisters(profile.parameters["VB01"].address, 1)
        model = ReadHoldingRegisters(MODEL_ADDRESS, 1)
        return (
            Question("register", status, is_always_there=True),
            Question("model", model, is_for_doubt=True),
            *super().questions(profile),
        )

    def identity(self, profile: Profile, seen: Identity, answers: Mapping[str, Any]) -> Identity:
        """FC43 proves it; where that is not answered, VB00 = 15 denies it."""
        model = answers.get("model")
        if model is None or model[0] != SSW06_MODEL or seen.family_seen or seen.model:
            return denied_by_name(seen)
        return replace(seen, family_seen="ssw06", reason=f"{seen.reason}; VB00 is {model[0]}")

    def start_findings(self, settings: Settings) -> Iterator[Remark]:
        """See [ssw06-es 2.5-2.7, 4.2.3-4.3; ssw07 2.5-2.7, 4.2.2-4.3]."""
        codes = self.source_rows
        yield from unread(settings, codes, Topic.START)
        yield from sources(settings, codes, own=_SERIAL, name="Serial", own_modes=_MODE_BY_SERIAL)
        if settings.number("P630"):
            what = "right after a stop a start is ignored for a time, without an error"
            yield start(Weight.NOTE, f"{what}: {settings.shown('P630')}")
        known = [code for code in self.relays if settings.number(code) is not None]
        if known:  # the number that means Serial is not printed [ssw06-es 4.2.6; ssw07 4.2.3]
            shown = ", ".join(settings.shown(code) for code in known)
            what = "a relay follows `output` only where its function is Serial, whose number is not printed"
            yield Remark(Topic.OUTPUT, Weight.NOTE, f"{what}: {shown}")

    def watchdogs(self, settings: Settings) -> tuple[Watchdog, ...]:
        """E28 after P314 [ssw06-es 2.3, 2.4; ssw07 2.3, 2.4]."""
        after_s, action = settings.number("P314"), settings.number("P313")
        if not after_s:
            return ()
        is_serial = is_one_of((_SERIAL,), settings.number("P229"), settings.number("P230"))
        does, is_felt = "shows E28 and does nothing else", False
        if action == _RAMP_STOP and is_serial:
            does, is_felt = "shows E28 and stops the motor by ramp", True
        elif action == _RAMP_STOP:
            does = "shows E28; P313 = 1 does not stop the motor, since P229 and P230 are not Serial"
        elif action == _DISABLE:
            does, is_felt = "shows E28 and disables the motor, which coasts", True
        elif action == _TO_LOCAL and is_one_of(_MODE_BY_SERIAL, settings.number("P220")):
            does, is_felt = "shows E28 and changes to local", True
        elif action == _TO_LOCAL:
            does = "shows E28; P313 = 3 does not change to local, since P220 is not Serial"
        elif action == _FATAL:
            does, is_felt = "shows E28 as a fatal error: the motor is disabled until a reset", True
        elif action is None:
            does, is_felt = "shows E28 and does what P313 says, which could not be read", True
        return (Watchdog("P314", float(after_s), does, is_felt),)


DEVICE = Ssw07Device()
