"""Several rows at once: one read or write for neighbours, each row listed and read back."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import build, prepare
from gateway.families.profile.arguments import MOST
from gateway.families.profile.load import load_profile
from gateway.families.profile.procedure import Preparation
from tests.families.starters import READY, SLOT_1, built, frame, frames, own

ENTER, LEAVE = "01 05 00 01 FF 00 DD FA", "01 05 00 01 00 00 9C 0A"


def of(*codes: str) -> dict[str, Any]:
    return {"parameters": list(codes)}


def to(**values: object) -> dict[str, Any]:
    return {"parameters": {code.replace("_", "."): value for code, value in values.items()}}


def prepared(family: str, verb: str, args: dict[str, Any]) -> Preparation:
    return prepare(load_profile(family), SLOT_1, verb, args)


def refusal(family: str, verb: str, args: dict[str, Any]) -> str:
    with pytest.raises(CommandError) as caught:
        prepared(family, verb, args)
    return caught.value.code


def test_neighbours_are_read_in_one_request_and_listed_in_the_order_asked() -> None:
    preparation = prepared("ssw07", "read", of("P003", "p002", "P003"))

    assert [(frame(read.request), read.codes) for read in preparation.reads] == [
        ("01 03 00 02 00 02 65 CB", ("P002", "P003"))
    ]
    assert built("ssw07", "read", of("P003", "p002", "P003")).subjects == ("P003", "P002")


def test_a_row_that_the_manual_does_not_vouch_for_is_read_alone() -> None:
    reads = prepared("ssw07", "read", of("P002", "P003", "P004", "P005")).reads

    assert [read.codes for read in reads] == [("P002", "P003"), ("P004",), ("P005",)]


def test_rows_may_be_named_in_one_text() -> None:
    text = {"parameters": "P003,P002"}

    assert prepared("ssw07", "read", text) == prepared("ssw07", "read", of("P003", "P002"))
    assert frames("ssw07", "set", {"parameters": "P314=30,P313=1"}) == frames(
        "ssw07", "set", to(P314=30, P313=1)
    )


def test_one_row_in_a_list_is_returned_as_several() -> None:
    assert built("ssw07", "read", of("P003")).subjects == ("P003",)


def test_neighbouring_registers_are_written_in_one_request() -> None:
    procedure = built("ssw07", "set", to(P314=30, P313=1, P229=2), P314=0, P313=0, P229=0)

    assert [frame(request)[:-6] for request in own(procedure)] == [
        "01 06 00 E5 00 02",
        "01 10 01 39 00 02 04 00 01 00 1E",
    ]
    assert procedure.subjects == ("P314", "P313", "P229")
    assert procedure.wears == 3


def test_32_bit_neighbours_go_in_one_request_low_words_first() -> None:
    (found,) = frames("ssw900", "set", to(C11_3_2=7, C11_3_1=-5))

    assert found[:-6] == "01 10 04 56 00 04 08 FF FB FF FF 00 07 00 00"


def test_only_what_differs_is_written_and_all_is_read_back() -> None:
    procedure = built("ssw07", "set", to(P314=30, P313=1), P314=30, P313=0)

    assert [frame(step.request)[:-6] for step in procedure.steps] == ["01 06 01 39 00 01"]
    assert procedure.wears == 1
    assert procedure.verify is not None
    assert procedure.verify.is_met({"P314": (30,), "P313": (1,)})
    assert not procedure.verify.is_met({"P314": (29,), "P313": (1,)})
    assert not procedure.verify.is_met({"P313": (1,)})


def test_rows_that_hold_their_values_already_are_not_written() -> None:
    procedure = built("ssw07", "set", to(P314=30, P313=1), P314=30, P313=1)

    assert (procedure.is_unchanged, procedure.subjects) == (True, ("P314", "P313"))


def test_a_run_is_no_longer_than_the_family_takes() -> None:
    profile = load_profile("ssw900")
    short = profile.model_copy(update={"limits": profile.limits.model_copy(update={"write_registers": 3})})

    steps = build(short, SLOT_1, "set", to(C11_3_1=1, C11_3_2=2), seen={}).steps

    assert len(steps) == 2


def test_outputs_are_not_stored_and_do_not_wear() -> None:
    assert built("ssw06", "set", {"parameter": "VB08", "value": 1}).wears == 0
    assert built("ssw900", "set", {"parameter": "S5.3.1", "value": 1}).wears == 0
    assert built("ssw06", "set", {"parameter": "P314", "value": 1}).wears == 1


def test_the_registers_of_an_sst_are_written_one_by_one_in_one_procedure_which_wears_once() -> None:
    procedure = built("sst", "set", to(R41=30, R33=2.0), R41=0, R33=0, COIL1=0, R19=0)

    found = [frame(request) for request in own(procedure)]
    assert (found[0], found[-1], len(found)) == (ENTER, LEAVE, 4)
    assert procedure.subjects == ("R41", "R33")
    assert procedure.wears == 1


def test_one_stopped_row_among_others_demands_a_motor_at_rest() -> None:
    assert prepared("ssw900", "set", to(C8_2_5_3=5.0, C8_1_1_5=680)).requires == ("is_stopped",)
    assert prepared("ssw900", "set", to(C8_2_5_3=5.0, C11_3_1=1)).requires == ()


@pytest.mark.parametrize("code", ["P220", "P229", "P230"])
def test_who_commands_the_motor_changes_only_at_standstill(code: str) -> None:
    assert prepared("ssw07", "set", {"parameter": code, "value": 1}).requires == ("is_stopped",)
    assert len(frames("ssw07", "set", {"parameter": code, "value": 1}, VB01=READY, VB03=0, **{code: 0})) == 1


def test_a_timeout_is_made_active_once_its_time_stands() -> None:
    arm = to(C8_2_5_1=2, C8_2_5_3=5.0)
    time, mode = built("ssw900", "set", arm, C8_2_5_1=0, C8_2_5_3=0).steps

    assert frame(time.request)[:-6] == "01 06 02 DE 00 32"
    assert time.then is not None
    assert time.then.is_met({"C8.2.5.3": (50,)})
    assert not time.then.is_met({"C8.2.5.3": (0,)})
    assert mode.then is None


def test_a_timeout_never_becomes_0_while_it_is_active() -> None:
    for values in (to(C8_2_5_1=2, C8_2_5_3=0.0), to(C8_2_5_1=0, C8_2_5_3=0.0)):
        with pytest.raises(CommandError, match="timeout_unset"):
            built("ssw900", "set", values, C8_2_5_1=1, C8_2_5_3=50)


@pytest.mark.parametrize(
    ("family", "verb", "args", "code"),
    [
        ("ssw07", "read", {"parameters": []}, "bad_arguments"),
        ("ssw07", "read", {"parameters": 3}, "bad_arguments"),
        ("ssw07", "read", {"parameters": ["P002", 3]}, "bad_arguments"),
        ("ssw07", "read", {"parameters": ["P002"], "parameter": "P003"}, "bad_arguments"),
        ("ssw07", "read", {"parameters": ["P002"] * (MOST + 1)}, "bad_arguments"),
        ("ssw07", "read", of("P002", "X1"), "unknown_parameter"),
        ("ssw07", "read", of("P002", "P200"), "not_readable"),
        ("ssw07", "set", {"parameters": {}}, "bad_arguments"),
        ("ssw07", "set", {"parameters": ["P314"]}, "bad_arguments"),
        ("ssw07", "set", {"parameters": "P314"}, "bad_arguments"),
        ("ssw07", "set", {"parameters": {"P314": 1}, "value": 1}, "bad_arguments"),
        ("ssw07", "set", {"parameters": {"P314": 1, "p314": 2}}, "bad_arguments"),
        ("ssw07", "set", to(P314=1, P003=1), "not_writable"),
        ("ssw07", "set", to(P314=1, P313=9), "out_of_range"),
        ("ssw07", "set", to(P314=1, P308=9), "would_cut_connection"),
    ],
)
def test_one_bad_row_refuses_all_before_anything_is_read(
    family: str, verb: str, args: dict[str, Any], code: str
) -> None:
    assert refusal(family, verb, args) == code


@pytest.mark.parametrize("code", ["C10.1.1", "C10.2.1", "C10.3.1", "C10.4.1", "C10.5.1"])
def test_actions_on_all_parameters_are_not_set(code: str) -> None:
    with pytest.raises(CommandError, match=r"not_writable: .* is an action on all parameters"):
        prepared("ssw900", "set", {"parameter": code, "value": 1})


@pytest.mark.parametrize(
    ("family", "code", "why"),
    [
        ("ssw06", "P000", "no password is needed"),
        ("ssw07", "P000", "no password is needed"),
        ("ssw06", "P200", "not accessible through serial"),
        ("ssw07", "P215", "not accessible through serial"),
    ],
)
def test_what_the_serial_line_does_not_reach_is_refused_with_the_reason(
    family: str, code: str, why: str
) -> None:
    with pytest.raises(CommandError, match=why):
        prepared(family, "set", {"parameter": code, "value": 1})


@pytest.mark.parametrize("value", [99, "Sometimes"])
def test_another_option_of_a_list_is_refused_with_the_list(value: object) -> None:
    with pytest.raises(CommandError) as caught:
        prepared("ssw900", "set", {"parameter": "C8.2.5.1", "value": value})

    assert "0 (Inactive), 1 (" in caught.value.text
