"""The command word of the SSW900: no mask, so it is built from what is in force (S9-07, S9-08, X-02)."""

from __future__ import annotations

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import prepare
from gateway.families.profile.load import load_profile
from gateway.modbus.writes import MaskWriteRegister, WriteRegister
from tests.families.starters import (
    ENABLED,
    FAULT,
    JOG,
    NO_SLOT,
    REMOTE,
    REVERSE,
    RUNNING,
    SLOT_2,
    built,
    frames,
    own,
    words,
)

ON, OFF = {"value": True}, {"value": False}


@pytest.mark.parametrize(
    ("verb", "args", "last", "expected"),
    [
        ("start", {}, 0x0012, [0x0013]),
        ("start", {}, 0x009A, [0x001B]),  # the reset bit goes
        ("stop", {}, 0x0013, [0x0012]),
        ("stop", {}, 0x0016, [0x0012]),  # a jog stops too
        ("stop", {}, 0x0000, [0x0000]),
        ("reset", {}, 0x0012, [0x0012, 0x0092]),
        ("reset", {}, 0x0013, [0x0012, 0x0092]),  # only at standstill, so never with a run command
        ("reset", {}, 0x0092, [0x0012, 0x0092]),
        ("general_enable", ON, 0x0010, [0x0012]),
        ("general_enable", OFF, 0x0012, [0x0010]),
        ("start", {}, 0xFF72, [0x0013]),  # reserved bits stay 0
    ],
)
def test_a_command_changes_its_bit_in_the_last_word(
    verb: str, args: dict[str, bool], last: int, expected: list[int]
) -> None:
    assert words(built("ssw900", verb, args, S5_2_5=last)) == [(685, word) for word in expected]


def test_the_start_of_an_ssw900_is_this_frame() -> None:
    assert frames("ssw900", "start", S5_2_5=0x12) == ["01 06 02 AD 00 13 58 5E"]


def test_the_word_of_the_slot_that_holds_the_accessory_is_written() -> None:
    procedure = built("ssw900", "start", variant=SLOT_2, S5_2_5=0x00, S5_2_6=0x12)

    assert words(procedure) == [(686, 0x0013)]


@pytest.mark.parametrize("last", [0x0000, 0x0012, 0x0008])
def test_what_the_device_hides_of_its_word_is_taken_from_its_status(last: int) -> None:
    procedure = built("ssw900", "start", S5_2_5=last, S5_1_1=ENABLED | REMOTE)

    assert words(procedure) == [(685, 0x0013)]


def test_the_direction_in_force_stays() -> None:
    assert words(built("ssw900", "start", S5_2_5=0x12, S5_1_1=ENABLED | REMOTE | REVERSE)) == [(685, 0x001B)]


def test_a_general_disable_and_a_local_mode_in_force_stay() -> None:
    assert words(built("ssw900", "reset", S5_2_5=0x12, S5_1_1=FAULT)) == [(685, 0x0000), (685, 0x0080)]


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        (ENABLED | REMOTE, 0x0010),
        (ENABLED | REMOTE | RUNNING, 0x0011),
        (ENABLED | REMOTE | (1 << 4), 0x0011),  # accelerating
    ],
)
def test_a_general_disable_keeps_the_run_command_only_while_the_motor_obeys_it(
    status: int, expected: int
) -> None:
    assert words(built("ssw900", "general_enable", OFF, S5_2_5=0x13, S5_1_1=status)) == [(685, expected)]


@pytest.mark.parametrize(("status", "expected"), [(ENABLED | JOG, 0x04), (ENABLED, 0x00)])
def test_a_jog_command_stays_only_while_the_motor_obeys_it(status: int, expected: int) -> None:
    procedure = built("ssw900", "general_enable", OFF, S5_2_5=0x06, S5_1_1=status)

    assert words(procedure)[-1] == (685, expected)


def test_the_status_alone_is_enough_for_a_start() -> None:
    assert words(built("ssw900", "start", S5_1_1=ENABLED | REMOTE)) == [(685, 0x0013)]


def test_a_start_with_neither_word_nor_status_is_refused() -> None:
    with pytest.raises(CommandError, match="word_unknown"):
        built("ssw900", "start")


def test_a_stop_of_which_nothing_is_known_clears_run_and_jog_and_nothing_else() -> None:
    assert frames("ssw900", "stop") == ["01 16 02 AD FF FA 00 00 4A 19"]


@pytest.mark.parametrize("word", [0x0000, 0x0010, 0x0002, 0x001A, 0xFFFA])
def test_what_is_cleared_by_mask_is_run_and_jog(word: int) -> None:
    (mask,) = own(built("ssw900", "stop"))

    assert isinstance(mask, MaskWriteRegister)
    assert {mask.apply(word | motion) for motion in (0, 1, 4, 5)} == {word}


def test_the_end_of_a_jog_of_which_nothing_is_known_clears_jog_and_nothing_else() -> None:
    assert own(built("ssw900", "jog", OFF)) == [MaskWriteRegister(685, 0xFFFB, 0)]


def test_a_stop_writes_the_words_of_both_slots_while_the_slot_is_unknown() -> None:
    stop = own(built("ssw900", "stop", variant=NO_SLOT, S5_2_6=0x1B))

    assert stop == [MaskWriteRegister(685, 0xFFFA, 0), WriteRegister(686, 0x001A)]


@pytest.mark.parametrize(("verb", "args"), [("start", {}), ("reset", {}), ("general_enable", ON)])
def test_everything_but_a_stop_needs_the_slot(verb: str, args: dict[str, bool]) -> None:
    with pytest.raises(CommandError, match="slot_unknown"):
        prepare(load_profile("ssw900"), NO_SLOT, verb, args)
    with pytest.raises(CommandError, match="slot_unknown"):
        built("ssw900", verb, args, variant=NO_SLOT, S5_2_5=0x12)


def test_rows_are_read_and_set_without_knowing_the_slot() -> None:
    profile = load_profile("ssw900")

    assert prepare(profile, NO_SLOT, "read", {"parameter": "S1.1.4"}).reads
    assert prepare(profile, NO_SLOT, "set", {"parameter": "S5.3.1", "value": 1}).reads
