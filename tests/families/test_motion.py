"""Jog, direction and local/remote: what is written, what is demanded, what is read back."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import build, prepare
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from tests.families.starters import (
    ENABLED,
    JOG,
    NO_SLOT,
    NOT_STARTING,
    READY,
    REMOTE,
    RUNNING,
    SLOT_1,
    SLOT_2,
    built,
    frames,
    words,
)

WEG = ("ssw06", "ssw07", "ssw900")
ON, OFF = {"value": True}, {"value": False}
FORWARD, REVERSE_ = {"value": "forward"}, {"value": "reverse"}
LOCAL, REMOTE_ = {"value": "local"}, {"value": "remote"}
REST_900 = ENABLED | REMOTE  # S5.1.1 of an SSW900 at rest


@pytest.mark.parametrize(
    ("verb", "args", "word"),
    [
        ("jog", ON, 0x0404),
        ("jog", OFF, 0x0400),
        ("direction", REVERSE_, 0x0808),
        ("direction", FORWARD, 0x0800),
        ("local_remote", REMOTE_, 0x1010),
        ("local_remote", LOCAL, 0x1000),
    ],
)
def test_an_ssw06_is_moved_by_one_masked_bit(verb: str, args: Any, word: int) -> None:
    assert words(built("ssw06", verb, args, VB01=READY, VB03=0x12)) == [(5003, word)]


@pytest.mark.parametrize(
    ("verb", "args", "start"),
    [
        ("jog", ON, "01 05 00 66 FF 00"),
        ("jog", OFF, "01 05 00 66 00 00"),
        ("direction", REVERSE_, "01 05 00 67 FF 00"),
        ("direction", FORWARD, "01 05 00 67 00 00"),
        ("local_remote", REMOTE_, "01 05 00 68 FF 00"),
        ("local_remote", LOCAL, "01 05 00 68 00 00"),
    ],
)
def test_an_ssw07_is_moved_by_one_coil(verb: str, args: Any, start: str) -> None:
    (frame,) = frames("ssw07", verb, args, VB01=READY, VB03=0x12)

    assert frame.startswith(start)


@pytest.mark.parametrize(
    ("verb", "args", "status", "word"),
    [
        ("jog", ON, REST_900, 0x16),
        ("jog", OFF, REST_900 | JOG, 0x12),
        ("direction", REVERSE_, REST_900, 0x1A),
        ("direction", FORWARD, REST_900 | 1 << 11, 0x12),
        ("local_remote", REMOTE_, ENABLED, 0x12),
        ("local_remote", LOCAL, REST_900, 0x02),
    ],
)
def test_an_ssw900_is_moved_by_a_bit_of_the_word_in_force(
    verb: str, args: Any, status: int, word: int
) -> None:
    assert words(built("ssw900", verb, args, S5_1_1=status, S5_2_5=0x12)) == [(685, word)]
    assert words(built("ssw900", verb, args, variant=SLOT_2, S5_1_1=status, S5_2_6=0x12)) == [(686, word)]


@pytest.mark.parametrize("family", WEG)
def test_a_jog_demands_what_a_start_demands(family: str) -> None:
    profile = load_profile(family)

    jog, start = (prepare(profile, SLOT_1, verb, args) for verb, args in (("jog", ON), ("start", {})))

    assert jog.requires == start.requires
    assert jog.reads == start.reads


@pytest.mark.parametrize("family", WEG)
def test_nothing_forbids_the_end_of_a_jog(family: str) -> None:
    assert prepare(load_profile(family), NO_SLOT, "jog", OFF).requires == ()
    assert built(family, "jog", OFF, variant=NO_SLOT).steps


def test_the_end_of_a_jog_of_an_ssw900_keeps_what_is_in_force_and_knows_it_only_by_reading() -> None:
    codes = [read.codes for read in prepare(load_profile("ssw900"), NO_SLOT, "jog", OFF).reads]

    assert codes == [("S5.1.1", "S5.2.5", "S5.2.6")]
    assert words(built("ssw900", "jog", OFF, S5_1_1=REST_900 | RUNNING, S5_2_5=0x17)) == [(685, 0x13)]


@pytest.mark.parametrize(("family", "count"), [("ssw06", 2), ("ssw07", 2), ("ssw900", 1)])
def test_a_stop_takes_a_jog_back_too(family: str, count: int) -> None:
    rows = {"S5_1_1": REST_900 | JOG, "S5_2_5": 0x16} if family == "ssw900" else {"VB01": READY | JOG}

    found = frames(family, "stop", **rows)

    assert len(found) == count
    if family == "ssw06":
        assert [frame[12:17] for frame in found] == ["01 00", "04 00"]
    if family == "ssw900":
        assert words(built(family, "stop", **rows)) == [(685, 0x12)]


@pytest.mark.parametrize("family", WEG)
def test_a_stop_is_not_seen_while_the_motor_jogs(family: str) -> None:
    verify = built(family, "stop").verify

    assert verify is not None
    assert verify.is_met({**NOT_STARTING, "jog": False})
    assert not verify.is_met({**NOT_STARTING, "jog": True})


def test_a_stop_of_an_old_ssw07_does_not_look_for_a_bit_that_it_does_not_have() -> None:
    verify = built("ssw07", "stop", variant=Variant(firmware="1.30")).verify

    assert verify is not None
    assert verify.is_met({"running": False, "jog": True})


@pytest.mark.parametrize("family", WEG)
@pytest.mark.parametrize("args", [FORWARD, REVERSE_])
def test_the_direction_changes_only_at_standstill(family: str, args: Any) -> None:
    requires = prepare(load_profile(family), SLOT_1, "direction", args).requires

    assert "is_stopped" in requires


@pytest.mark.parametrize(("verb", "args"), [("jog", ON), ("direction", FORWARD), ("direction", REVERSE_)])
def test_an_ssw07_before_v1_40_neither_jogs_nor_turns_the_other_way(verb: str, args: Any) -> None:
    profile = load_profile("ssw07")

    with pytest.raises(CommandError, match=r"not_in_firmware: .* from 1\.40, this is V1\.32"):
        prepare(profile, Variant(firmware="V1.32"), verb, args)
    assert prepare(profile, Variant(firmware="V1.4x 0"), verb, args).reads
    assert prepare(profile, Variant(), verb, args).reads


@pytest.mark.parametrize(
    ("family", "code", "numbers"), [("ssw06", "P220", (5, 6)), ("ssw07", "P220", (5, 6))]
)
def test_local_and_remote_need_the_serial_line_as_their_source(
    family: str, code: str, numbers: tuple[int, ...]
) -> None:
    profile = load_profile(family)

    assert code in {
        code for read in prepare(profile, SLOT_1, "local_remote", LOCAL).reads for code in read.codes
    }
    for number in range(9):
        seen = {code: (number,), "VB01": (READY,), "VB03": (0,)}
        if number in numbers:
            assert build(profile, SLOT_1, "local_remote", LOCAL, seen=seen).steps
        else:
            with pytest.raises(CommandError, match=r"not_set_to_serial: .* not 5 .* or 6 "):
                build(profile, SLOT_1, "local_remote", LOCAL, seen=seen)


def test_local_and_remote_of_an_ssw900_need_a_slot_as_their_source() -> None:
    for number in range(13):
        rows = {"C3_1": number, "S5_1_1": REST_900, "S5_2_5": 0x12}
        if number >= 9:
            assert built("ssw900", "local_remote", LOCAL, **rows).steps
        else:
            with pytest.raises(CommandError, match="not_set_to_serial"):
                built("ssw900", "local_remote", LOCAL, **rows)


@pytest.mark.parametrize("family", WEG)
def test_a_command_that_gives_the_control_away_says_so(family: str) -> None:
    rows: dict[str, Any] = {"S5_1_1": REST_900} if family == "ssw900" else {"VB01": READY, "VB03": 0}

    assert "not even a stop" in built(family, "local_remote", LOCAL, **rows).note
    assert "not even a stop" not in built(family, "local_remote", REMOTE_, **rows).note


@pytest.mark.parametrize("verb", ["direction", "local_remote"])
def test_another_word_is_refused_with_the_list_of_what_is_allowed(verb: str) -> None:
    profile = load_profile("ssw06")

    with pytest.raises(CommandError) as caught:
        prepare(profile, SLOT_1, verb, {"value": "up"})

    assert caught.value.code == "bad_arguments"
    assert all(value in caught.value.text for value in profile.commands[verb].values)


@pytest.mark.parametrize(
    ("verb", "args", "point", "becomes"),
    [
        ("jog", ON, "jog", True),
        ("jog", OFF, "jog", False),
        ("direction", {"value": " Reverse"}, "reverse", True),
        ("direction", FORWARD, "reverse", False),
        ("local_remote", REMOTE_, "remote", True),
        ("local_remote", LOCAL, "remote", False),
    ],
)
def test_each_is_read_back_from_the_status(verb: str, args: Any, point: str, *, becomes: bool) -> None:
    for family, rows in (("ssw06", {}), ("ssw07", {}), ("ssw900", {"S5_1_1": REST_900})):
        verify = built(family, verb, args, **rows).verify
        assert verify is not None
        assert verify.is_met({**NOT_STARTING, point: becomes})
        assert not verify.is_met({**NOT_STARTING, point: not becomes})


def test_an_sst_is_reset_whole_only_at_standstill_and_then_silent() -> None:
    profile = load_profile("sst")
    whole = {"whole": True}

    assert prepare(profile, SLOT_1, "reset", whole).requires == ("serial_controls", "is_stopped")
    procedure = build(profile, SLOT_1, "reset", whole, seen={"COIL1": (0,), "R19": (0,)})
    assert [step.request.encode().hex() for step in procedure.steps] == ["0500000000", "050003ff00"]
    assert procedure.steps[-1].is_silence_expected
    assert procedure.verify is not None
    assert procedure.verify.is_met({"configured": False, "running": False})
    assert procedure.verify.within_s > profile.timing.restart_s
    assert "configure" in procedure.note


def test_an_sst_that_is_not_to_be_reset_whole_is_reset_as_ever() -> None:
    assert frames("sst", "reset", {"whole": False}, COIL1=0, R19=0) == ["01 05 00 02 FF 00 2D FA"]
    with pytest.raises(CommandError, match="whole is unknown"):
        prepare(load_profile("ssw07"), SLOT_1, "reset", {"whole": True})
