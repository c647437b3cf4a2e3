"""A run command that stands in a starter is taken back before whatever could let it act; of every family."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from gateway.contract import CommandError, Note
from gateway.families.command.interlock import check
from gateway.families.command.procedures import build, prepare, verbs
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.procedure import Procedure, WriteStep
from gateway.families.profile.rows import Parameter
from gateway.families.profile.schema import Profile, Variant
from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil, WriteRegister
from tests.families.notation import built, rows, writes

SLOTS = pytest.mark.parametrize("variant", [rows("slot=1")[0], rows("slot=2")[0]], ids=["slot 1", "slot 2"])
SLOT_1 = rows("")[0]
RUN_COIL = {"ssw06": 100, "ssw07": 100, "sst": 0}
AT_REST = {
    "ssw06": "VB01=0x4102 VB03=0 VB06=3 P220=6",
    "ssw07": "VB01=0x4102 VB03=0 P220=6",
    "ssw900": "S5.1.1=0x0102 S5.2.5=0 S5.2.6=0 C3.1=10",
    "sst": "R19=0 COIL1=0 COIL5=1 COIL7=0 COIL8=0 COIL9=1",
}
TURNING = {"ssw06": "VB01=0x4103", "ssw07": "VB01=0x4103", "ssw900": "S5.1.1=0x0103", "sst": "R19=2"}
# What may be written without run = 0 before it, as the manuals have it: a motion or its end, and the outputs
# (ssw06-es 4.2.3, 4.2.6-4.2.8; ssw07 4.2.2, 4.2.3; ssw900 S5.2, S5.3; the SST's coil 1).
HARMLESS_COILS = {"ssw06": {100, 102}, "ssw07": {100, 102}, "ssw900": set(), "sst": {0}}
# What no `set` may write: command words, and rows of the connection itself; it writes no coil at all.
FORBIDDEN = {5003, 5007, 308, 312, *range(681, 687), *range(730, 734)}
SOURCES = {
    "ssw06": {220, 229, 230},
    "ssw07": {220, 229, 230},
    "ssw900": {220, 229, 230, 231, *range(263, 269), 207, 208, 337, 338, 1101, 1102},
    "sst": {4, 5, 6, *range(30, 43)},
}


def is_run_off(profile: Profile, step: WriteStep) -> bool:
    """Return from the bytes alone whether a write takes the run command back."""
    match step.request:
        case WriteCoil(address=address, is_on=is_on):
            return address == RUN_COIL.get(profile.family) and not is_on
        case WriteRegister(address=address, word=word):
            if profile.family == "ssw06":
                return address == 5003 and word & 0x0101 == 0x0100
            return profile.family == "ssw900" and address in (685, 686) and not word & 0x05
    return False


def wakes(profile: Profile, step: WriteStep) -> bool:
    """Return from the bytes alone whether a write may let a run command act that stands."""
    pdu = step.request.encode()
    address, word = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    if pdu[0] == 5:
        is_disabling = profile.family != "sst" and address == 101 and not word
        return address not in HARMLESS_COILS[profile.family] and not is_disabling
    count = int.from_bytes(pdu[3:5], "big") if pdu[0] == 16 else 1
    if SOURCES[profile.family] & set(range(address, address + count)):
        return True
    if profile.family == "ssw06" and address == 5003:  # mask and value of enable, direction, mode, reset
        return bool(word & 0x9800) or word & 0x0202 == 0x0202
    return address in (5003, 5007, 685, 686) and not (
        profile.family == "ssw900" and is_run_off(profile, step)
    )


def values_of(profile: Profile, row: Parameter) -> Iterator[Any]:
    """Yield values that a `set` may take, the lowest and the highest, also of an enum."""
    members = [number for number, label in profile.enums.get(row.enum, {}).items() if label != "Reserved"]
    numbers = members or [row.raw_min or 0, row.raw_max or 0]
    scale = 10 ** (row.decimals or 0)
    for number in (min(numbers), max(numbers)):
        yield number / scale if scale > 1 else number


def every_command(profile: Profile) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every verb with every choice of its arguments, and a set of every row."""
    for verb in verbs(profile):
        if verb == "set":
            for row in profile.parameters.values():
                yield from (
                    ("set", {"parameter": row.code, "value": each}) for each in values_of(profile, row)
                )
        elif verb == "output":
            yield from (
                (verb, {"output": name, "value": value}) for name in profile.outputs for value in (True, 50)
            )
        elif verb == "configure" and profile.family == "ssw06":
            yield from ((verb, {"leave": mode}) for mode in ("factory", "P202"))
        elif verb == "configure":
            yield from ((verb, args) for args in ({}, {"R41": 30}, {"R40": 10}))
        elif verb == "reset":
            yield from ((verb, args) for args in ({}, {"whole": True}))
        elif verb == "read":
            yield verb, {"parameter": next(iter(profile.parameters))}
        elif profile.commands[verb].args:
            yield from ((verb, {"value": value}) for value in (True, False, *profile.commands[verb].values))
        else:
            yield verb, {}


def every_procedure(family: str, variant: Variant) -> Iterator[tuple[str, dict[str, Any], Procedure]]:
    """Yield what can be built of all that, of a motor at rest."""
    profile = load_profile(family)
    for verb, args in every_command(profile):
        try:
            yield verb, args, build(profile, variant, verb, args, seen=rows(AT_REST[family])[1])
        except CommandError:
            continue


@SLOTS
@pytest.mark.parametrize("family", FAMILIES)
def test_no_procedure_of_any_verb_and_any_row_wakes_a_run_command_before_run_is_0(
    family: str, variant: Variant
) -> None:
    profile = load_profile(family)
    count = 0

    for verb, args, procedure in every_procedure(family, variant):
        waking = [place for place, step in enumerate(procedure.steps) if wakes(profile, step)]
        if verb in ("start", "jog") or not waking:
            continue
        count += 1
        first = procedure.steps[: waking[0]]
        assert any(is_run_off(profile, step) and step.is_run_off for step in first), (verb, args)
        assert Note("run_cleared") in procedure.notes, (verb, args)
        assert procedure.verify is not None, (verb, args)
        assert not procedure.verify.is_met(
            {procedure.verify.name: procedure.verify.is_one_of[0], "running": True}
        )

    assert count >= 4


@SLOTS
@pytest.mark.parametrize("family", FAMILIES)
def test_only_a_start_sets_run_and_a_set_writes_neither_command_words_nor_the_connection(
    family: str, variant: Variant
) -> None:
    profile = load_profile(family)

    for verb, args, procedure in every_procedure(family, variant):
        own = [step.request for step in procedure.steps if not (step.is_run_off or step.may_be_refused)]
        if verb != "start":
            assert not any(sets_run(profile, request) for request in [*own, *procedure.abandon]), (verb, args)
        if verb == "set" and family != "sst":
            assert not {int.from_bytes(request.encode()[1:3]) for request in own} & FORBIDDEN, args
            assert all(request.encode()[0] != 5 for request in own), args
        if family == "sst":
            check_configuration_mode(procedure)


def sets_run(profile: Profile, request: Request) -> bool:
    pdu = request.encode()
    address, word = int.from_bytes(pdu[1:3]), int.from_bytes(pdu[3:5])
    if pdu[0] == 5:
        return address == RUN_COIL.get(profile.family) and word == 0xFF00
    if profile.family == "ssw06":
        return address == 5003 and word & 0x0101 == 0x0101
    return profile.family == "ssw900" and pdu[0] == 6 and address in (685, 686) and bool(word & 1)


def check_configuration_mode(procedure: Procedure) -> None:
    """Assert that a register is written only between entering and leaving the mode of an SST."""
    is_in_mode = False
    for step in procedure.steps:
        pdu = step.request.encode()
        if pdu[:3] == b"\x05\x00\x01":
            is_in_mode = pdu[3] == 0xFF
            assert step.then is not None
        assert pdu[0] == 5 or is_in_mode
    assert not is_in_mode
    leaves = [request.encode() == b"\x05\x00\x01\x00\x00" for request in procedure.abandon]
    assert any(leaves) == any(step.request.encode()[:3] == b"\x05\x00\x01" for step in procedure.steps)


@SLOTS
@pytest.mark.parametrize("family", FAMILIES)
def test_run_is_set_to_0_only_where_it_is_read_that_the_motor_stands(family: str, variant: Variant) -> None:
    profile = load_profile(family)

    for verb, args, procedure in every_procedure(family, variant):
        if not any(step.is_run_off for step in procedure.steps):
            continue
        preparation = prepare(profile, variant, verb, args)
        codes = {code for read in preparation.reads for code in read.codes}
        assert "is_stopped" in preparation.requires, (verb, args)
        assert {"R19" if family == "sst" else profile.status_word} <= codes, (verb, args)
        assert check(profile, preparation.requires, {}), (verb, args)  # what is not known is not standing
        with pytest.raises(CommandError, match="motor_running"):
            build(profile, variant, verb, args, seen=rows(f"{AT_REST[family]} {TURNING[family]}")[1])


@pytest.mark.parametrize("family", FAMILIES)
def test_a_stop_and_the_end_of_a_motion_wait_for_no_reading_and_clear_nothing_else(family: str) -> None:
    profile = load_profile(family)
    ends = [("stop", {})]
    if family != "sst":
        ends += [("jog", {"value": False}), ("general_enable", {"value": False})]

    for verb, args in ends:
        procedure = build(profile, SLOT_1, verb, args, seen=rows(f"{AT_REST[family]} {TURNING[family]}")[1])
        assert "is_stopped" not in prepare(profile, SLOT_1, verb, args).requires
        assert not any(step.is_run_off for step in procedure.steps)


def test_every_row_that_chooses_the_command_source_is_named_in_its_familys_data() -> None:
    for family in FAMILIES:
        profile = load_profile(family)
        protected = (*profile.protected.command_sources, *profile.protected.waking)
        named = {profile.parameters[code].address for code in protected}
        named |= {row.address for row in profile.parameters.values() if row.is_configuration}
        assert (
            SOURCES[family] & {row.address for row in profile.parameters.values() if row.is_writable} <= named
        )


@pytest.mark.parametrize(
    ("family", "text", "known", "expected"),
    [  # run and jog are 0 before the words of the command
        ("ssw07", "reset", "firmware=1.30", "c100:0 c107:0 c107:1"),  # a jog that it does not have
        ("ssw900", "set C3.3=5", "slot=2", "685:0012 686:0012 230:0005"),  # the words of both slots
    ],
)
def test_run_and_jog_are_0_around_the_words_of_a_command(
    family: str, text: str, known: str, expected: str
) -> None:
    assert writes(family, text, f"{AT_REST[family]} {known}", whole=True) == expected


def test_the_run_command_must_read_0_where_it_can_be_read() -> None:
    first, *_ = built("ssw06", "reset", "VB01=0xC102 VB03=1").steps

    assert first.then is not None
    assert first.then.is_met({"VB03": (0x12,)})
    assert not first.then.is_met({"VB03": (0x13,)})


def test_only_an_sst_that_is_not_initialised_may_refuse_run_0() -> None:
    barred, _ = built("sst", "reset", AT_REST["sst"] + " COIL5=0").steps
    free, _ = built("sst", "reset", AT_REST["sst"]).steps

    assert (barred.may_be_refused, free.may_be_refused) == (True, False)


@pytest.mark.parametrize("direction", [0x0000, 0x0800])
@pytest.mark.parametrize("mode", [0x0002, 0x0100, 0x0102])  # general enable, remote
def test_a_reset_of_an_ssw900_changes_nothing_that_is_in_force(mode: int, direction: int) -> None:
    for step in built("ssw900", "reset", f"S5.1.1={mode | direction} S5.2.5=0x1D").steps:
        word = int.from_bytes(step.request.encode()[3:5])
        assert (bool(word & 0x02), bool(word & 0x10)) == (bool(mode & 0x02), bool(mode & 0x0100))
        assert (bool(word & 0x08), word & 0x05) == (bool(direction), 0)
