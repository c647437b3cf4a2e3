"""The guarded procedure of the SST (ST-07, ST-08, ST-10 to ST-13)."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import prepare
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from tests.families.starters import built, frame, frames

ENTER, LEAVE = "01 05 00 01 FF 00 DD FA", "01 05 00 01 00 00 9C 0A"
UNDO_START = "01 05 00 00 00 00 CD CA"
R41_IS_30 = "01 06 00 29 00 1E D8 0A"
R33_IS_20 = "01 06 00 21 00 14 D9 CF"
AT_REST = {"COIL1": 0, "R19": 0}


def test_an_initialisation_enters_and_leaves_the_mode_even_when_nothing_is_to_be_changed() -> None:
    assert frames("sst", "configure", {}, **AT_REST) == [ENTER, LEAVE]


def test_only_registers_that_differ_are_written() -> None:
    args = {"R41": 30, "r33": 2.0}

    assert frames("sst", "configure", args, R41=30, R33=5, **AT_REST) == [ENTER, R33_IS_20, LEAVE]
    assert frames("sst", "configure", args, R41=0, R33=5, **AT_REST) == [ENTER, R41_IS_30, R33_IS_20, LEAVE]
    assert frames("sst", "configure", args, R41=30, R33=20, **AT_REST) == [ENTER, LEAVE]


def test_only_the_low_byte_decides_whether_a_register_differs() -> None:
    assert frames("sst", "configure", {"R41": 30}, R41=0x011E, **AT_REST) == [ENTER, LEAVE]


def test_a_set_of_a_configuration_register_is_the_same_procedure() -> None:
    args = {"parameter": "R41", "value": 30}

    procedure = built("sst", "set", args, R41=0, **AT_REST)

    assert [frame(step.request) for step in procedure.steps] == [UNDO_START, ENTER, R41_IS_30, LEAVE]
    assert procedure.subject == "R41"


def test_a_set_of_a_value_that_is_there_already_writes_nothing() -> None:
    procedure = built("sst", "set", {"parameter": "R41", "value": 30}, R41=30, **AT_REST)

    assert (procedure.is_unchanged, procedure.steps) == (True, ())


def test_the_mode_is_seen_before_the_first_register_and_its_end_before_the_read_back() -> None:
    procedure = built("sst", "configure", {"R41": 30}, R41=0, **AT_REST)
    _, enter, write, leave = procedure.steps

    assert enter.then is not None
    assert enter.then.is_met({"COIL2": (1,)})
    assert not enter.then.is_met({"COIL2": (0,)})
    assert write.then is None
    assert leave.then is not None
    assert leave.then.is_met({"COIL5": (1,)})
    assert leave.then.within_s == 5.0


def test_every_register_is_read_back_afterwards() -> None:
    verify = built("sst", "configure", {"R41": 30, "R33": 2.0}, R41=0, R33=0, **AT_REST).verify

    assert verify is not None
    assert [frame(read.request) for read in verify.reads] == [
        "01 04 00 13 00 01 C0 0F",
        "01 04 00 21 00 01 61 C0",
        "01 04 00 29 00 01 E0 02",
    ]
    assert verify.is_met({"R41": (0x0A1E,), "R33": (20,), "running": False})
    assert not verify.is_met({"R41": (30,), "R33": (21,), "running": False})
    assert not verify.is_met({"R41": (30,), "running": False})


def test_an_initialisation_alone_is_verified_by_coil_5() -> None:
    procedure = built("sst", "configure", {}, **AT_REST)

    assert procedure.verify is not None
    assert procedure.verify.is_met({"COIL5": (1,), "running": False})


def test_the_mode_is_left_when_something_failed() -> None:
    for verb, args in (("configure", {}), ("set", {"parameter": "R41", "value": 30})):
        assert [frame(request) for request in built("sst", verb, args, **AT_REST).abandon] == [
            LEAVE,
            UNDO_START,
        ]


@pytest.mark.parametrize(
    ("verb", "args"), [("configure", {"R33": 2.0}), ("set", {"parameter": "R33", "value": 2.0})]
)
def test_the_motor_must_rest_and_the_serial_line_be_in_control(verb: str, args: dict[str, Any]) -> None:
    preparation = prepare(load_profile("sst"), Variant(), verb, args)

    assert preparation.requires == ("serial_controls", "is_stopped")
    assert [(frame(read.request), read.codes) for read in preparation.reads] == [
        ("01 01 00 04 00 04 7C 08", ("COIL5", "COIL7", "COIL8")),
        ("01 04 00 13 00 01 C0 0F", ("R19",)),
        ("01 04 00 21 00 01 61 C0", ("R33",)),
    ]


@pytest.mark.parametrize(
    ("args", "code"),
    [
        ({"R41": 30, "r41": 31}, "bad_arguments"),
        ({"R12": 30}, "bad_arguments"),
        ({"COIL1": 1}, "bad_arguments"),
        ({"R99": 30}, "unknown_parameter"),
        ({"R41": 256}, "out_of_range"),
        ({"R41": "soon"}, "bad_value"),
    ],
)
def test_what_is_no_configuration_is_refused_before_anything_is_read(args: dict[str, Any], code: str) -> None:
    with pytest.raises(CommandError) as caught:
        prepare(load_profile("sst"), Variant(), "configure", args)

    assert caught.value.code == code


def test_a_value_that_this_model_does_not_allow_is_refused() -> None:
    prepare(load_profile("sst"), Variant(model="SST330i-M"), "configure", {"R33": 10.0})

    with pytest.raises(CommandError, match="out_of_range"):
        prepare(load_profile("sst"), Variant(model="SST130i-140-M"), "configure", {"R33": 10.0})
