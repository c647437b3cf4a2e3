"""Who answers: the requests that tell a starter's family, model, firmware and slot, and what the answers say.

Reads only. Nothing is taken for granted: a unit that proves nothing has no family.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from gateway.families.profile.decode import rated_current_a
from gateway.families.profile.joined import serial_of, text_of, version_of
from gateway.families.profile.schema import Profile, Type
from gateway.families.profile.word_types import to_text
from gateway.modbus.device_id import DeviceIdentification, ReadDeviceIdentification
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters, ReadInputRegisters


@dataclass(frozen=True, slots=True)
class Question:
    """One request of an identification; the answer is handed to `identify` under its tag."""

    tag: str  # fc43, model_register, slots, firmware, model, name
    request: Request


@dataclass(frozen=True, slots=True)
class Identity:
    """What a unit said about itself; None is unknown. `reason` says why the family is, or is not, known."""

    family_seen: str | None = None
    model: str | None = None
    firmware: str | None = None
    serial: str | None = None
    rated_current_a: float | None = None
    rating: str | None = None  # SSW900: the range of currents of its size (S3.3.1)
    slot: Literal[1, 2] | None = None  # SSW900: where the RS-485 accessory sits
    accessories: tuple[str, ...] = ()  # SSW900: the kinds in slots 1 and 2
    hardware: str | None = None  # SST: its version
    reason: str = ""
    lacks: str = ""  # what every device of the configured family has and this one has not; empty: nothing


def identify_requests(profile: Profile) -> tuple[Question, ...]:
    """Return what to ask a unit that is configured as this family; any of them may stay without answer."""
    if profile.identification.how == "sst_registers":
        return (
            Question("model", ReadInputRegisters(0, 12)),  # model, versions, serial number
            Question("name", ReadInputRegisters(22, 8)),  # refused by old firmware (erratum of the SST text)
        )
    questions = [Question("fc43", ReadDeviceIdentification(read_code=1, object_id=0))]
    register = profile.identification.model_register
    if register:
        address = profile.parameters[register].address
        questions.append(Question("model_register", ReadHoldingRegisters(address, 1)))
    if len(profile.command_word) > 1:
        questions += _slot_questions(profile)
    return tuple(questions)


def identify(profile: Profile, answers: Mapping[str, Any]) -> Identity:
    """Return who the unit is; an answer is what `decode_reply` gave, None when there was none."""
    if profile.identification.how == "sst_registers":
        return _identify_sst(answers.get("model"), answers.get("name"))
    seen = _from_text(answers.get("fc43"))
    if profile.identification.model_register:
        return _with_model_register(profile, seen, answers.get("model_register"))
    if len(profile.command_word) > 1:
        return _with_slots(profile, seen, answers)
    return seen


def matches(profile: Profile, identity: Identity) -> bool:
    """Return whether the unit has proved to be of this family."""
    return why_not(profile, identity) is None


def why_not(profile: Profile, identity: Identity) -> str | None:
    """Return in words why the unit must not be taken for this family, None when it has proved to be of it."""
    if identity.lacks:
        return f"it is not {profile.family}: {identity.lacks}"
    if identity.family_seen == profile.family:
        return None
    if identity.family_seen is None:
        return f"not known to be {profile.family}: {identity.reason}"
    return f"it is {identity.family_seen}, not {profile.family}: {identity.reason}"


# "SSW-07 85.0A", "SSW-06 820A"; what the SSW900 and the SSW-08 say is not printed [ssw07 5.4.7].
_MODEL_TEXT = re.compile(r"SSW[- ]?(0?6|0?7|0?8|900)(?![0-9])", re.IGNORECASE)
_FAMILY_OF = {"6": "ssw06", "7": "ssw07", "8": "ssw07", "900": "ssw900"}  # one profile for SSW-07 and SSW-08

_PRODUCT, _REVISION = 1, 2  # objects of the basic identification [APP 6.21]
_SLOT_CONTENTS = range(9)  # S3.5.1, S3.5.2: 0 without .. 8 external current acquisition [ssw900 table A.2]
_RS485 = 2
_SST_MODELS = {330: "SST330i", 360: "SST360i", 130: "SST130i"}  # register 0


def _slot_questions(profile: Profile) -> tuple[Question, ...]:
    row = profile.parameters
    return (
        Question("slots", ReadHoldingRegisters(row["S3.5.1"].address, 2)),
        Question("firmware", ReadHoldingRegisters(row["S3.2.1"].address, 1)),
        # S3.3.1 to S3.3.4: the serial number's two words must stay together [ssw900 7.3]
        Question("model", ReadHoldingRegisters(row["S3.3.1"].address, 6)),
    )


def _from_text(answer: DeviceIdentification | None) -> Identity:
    if answer is None:
        return Identity(reason="it does not answer Read Device Identification (FC43)")
    text = _printable(answer.objects.get(_PRODUCT, ""))
    revision = _printable(answer.objects.get(_REVISION, "")).removeprefix("V") or None
    found = _MODEL_TEXT.search(text)
    if found is None:
        return Identity(model=text or None, firmware=revision, reason=f"FC43 names {text or 'no product'!r}")
    family = _FAMILY_OF[found[1].lstrip("0")]
    return Identity(
        family_seen=family,
        model=text,
        firmware=revision,
        rated_current_a=None if family == "ssw900" else rated_current_a(text),
        reason=f"FC43 names {text!r}",
    )


def _printable(text: str) -> str:
    """Return a text up to its first character that is not printable ASCII, such as what fills it up."""
    return "".join(itertools.takewhile(lambda each: each.isascii() and each.isprintable(), text)).strip()


def _with_model_register(profile: Profile, seen: Identity, answer: tuple[int, ...] | None) -> Identity:
    """VB00 is 15 on every SSW-06: it proves one that is silent to FC43, and any other value denies it."""
    if answer is None:
        return seen
    code, expected = profile.identification.model_register, profile.identification.model_value
    reading = f"{seen.reason}; {code} is {answer[0]}"
    is_expected = answer[0] == expected
    family, lacks = seen.family_seen, ""
    if is_expected and family is None and seen.model is None:
        family = profile.family
    elif not is_expected and family in (None, profile.family):
        family = None
        lacks = reading = f"{reading} and should be {expected}"
    return replace(seen, family_seen=family, reason=reading, lacks=lacks)


def _with_slots(profile: Profile, seen: Identity, answers: Mapping[str, Any]) -> Identity:
    slots = answers.get("slots") or ()
    is_plausible = bool(slots) and all(content in _SLOT_CONTENTS for content in slots) and _RS485 in slots
    is_named_otherwise = seen.family_seen not in (None, profile.family)
    if is_named_otherwise or not (seen.family_seen or is_plausible):
        return seen
    return replace(
        seen,
        family_seen=profile.family,
        model=seen.model or "SSW900",
        firmware=_package_version(answers.get("firmware")) or seen.firmware,
        serial=_double_word(answers.get("model")),
        rating=_rating(profile, answers.get("model")),
        slot=_slot(slots),
        accessories=tuple(profile.enums["S3.5.1"].get(content, str(content)) for content in slots),
        reason=f"{seen.reason}; slots 1 and 2 hold {slots}" if slots else seen.reason,
    )


def _slot(slots: tuple[int, ...]) -> Literal[1, 2] | None:
    """Return the slot of the RS-485 accessory; None when both or none says so [ssw900 3]."""
    if slots.count(_RS485) != 1:
        return None
    return 1 if slots[0] == _RS485 else 2


def _package_version(answer: tuple[int, ...] | None) -> str | None:
    return None if answer is None else f"{answer[0] / 100:.2f}"


def _double_word(answer: tuple[int, ...] | None) -> str | None:
    """Return S3.3.4 out of registers 294-299, low word first."""
    return None if answer is None else str(answer[4] | answer[5] << 16)


def _rating(profile: Profile, answer: tuple[int, ...] | None) -> str | None:
    """Return S3.3.1 in words."""
    return None if answer is None else profile.enums["S3.3.1"].get(answer[0])


def _identify_sst(registers: tuple[int, ...] | None, name: tuple[int, ...] | None) -> Identity:
    if registers is None:
        return Identity(reason="registers 0-11 are not answered")
    model = _SST_MODELS.get(registers[0])
    if model is None:
        return Identity(reason=f"register 0 is {registers[0]}, no model number of an SST")
    return Identity(
        family_seen="sst",
        model=text_of(name or ()) or model,
        firmware=version_of(registers[2:4]),
        hardware=to_text(Type.VERSION_LOW, registers[1:2]),
        serial=serial_of(registers[8:12]),
        reason=f"register 0 is {registers[0]}",
    )
