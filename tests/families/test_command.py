from __future__ import annotations

from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import build, prepare, verbs
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.procedure import REFUSALS, Preparation
from gateway.families.profile.schema import Variant
from tests.families.starters import (
    ACCELERATING,
    FAULT,
    NO_SLOT,
    NOT_STARTING,
    READY,
    RUNNING,
    SLOT_1,
    built,
    frame,
    frames,
    words,
)

ON, OFF = {"value": True}, {"value": False}


def prepared(
    family: str, verb: str, args: dict[str, Any] | None = None, variant: Variant = SLOT_1
) -> Preparation:
    return prepare(load_profile(family), variant, verb, args or {})


def refusal(family: str, verb: str, args: Any = None, *, variant: Variant = SLOT_1) -> CommandError:
    with pytest.raises(CommandError) as caught:
        prepare(load_profile(family), variant, verb, args or {})
    assert caught.value.code in REFUSALS
    return caught.value


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_starts_stops_resets_reads_and_sets(family: str) -> None:
    assert {"start", "stop", "reset", "read", "set"} <= set(verbs(load_profile(family)))
    assert ("configure" in verbs(load_profile(family))) == (family in ("sst", "ssw06"))
    others = {"general_enable", "jog", "direction", "local_remote", "output"} & set(
        verbs(load_profile(family))
    )
    assert len(others) == (0 if family == "sst" else 5)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("verb", ["general_enable_off", "jog_off", "reset_whole", "explode", ""])
def test_a_verb_that_the_family_does_not_have_is_refused(family: str, verb: str) -> None:
    profile = load_profile(family)

    assert refusal(family, verb).code == "unknown_verb"
    with pytest.raises(CommandError, match="unknown_verb"):
        build(profile, SLOT_1, verb, {}, seen={})


@pytest.mark.parametrize("family", ["ssw07", "ssw900"])
def test_only_the_sst_and_the_ssw06_have_something_to_configure(family: str) -> None:
    assert refusal(family, "configure").code == "unknown_verb"


# SSW-07: single coils (S7-02)


def test_an_ssw07_is_started_and_stopped_by_one_coil() -> None:
    assert frames("ssw07", "start") == ["01 05 00 64 FF 00 CD E5"]
    assert frames("ssw07", "stop") == ["01 05 00 64 00 00 8C 15"]


def test_no_command_ever_writes_the_word_of_an_ssw07_because_it_has_no_mask() -> None:
    for verb, args in (
        ("start", {}),
        ("stop", {}),
        ("reset", {}),
        ("general_enable", ON),
        ("general_enable", OFF),
        ("jog", ON),
        ("jog", OFF),
        ("direction", {"value": "reverse"}),
        ("direction", {"value": "forward"}),
        ("local_remote", {"value": "remote"}),
        ("local_remote", {"value": "local"}),
    ):
        assert words(built("ssw07", verb, args, VB01=READY, VB03=0)) == []


def test_an_ssw07_is_reset_by_the_edge_of_its_coil() -> None:
    assert frames("ssw07", "reset", VB01=FAULT, VB03=0x12) == [
        "01 05 00 6B 00 00 BC 16",
        "01 05 00 6B FF 00 FD E6",
    ]


# SSW-06: a masked word (S6-02, S6-03)


def test_an_ssw06_is_started_and_stopped_by_a_masked_word() -> None:
    assert words(built("ssw06", "start")) == [(5003, 0x0101)]
    assert words(built("ssw06", "stop")) == [(5003, 0x0100)]
    assert frames("ssw06", "start") == ["01 06 13 8B 01 01 3D 34"]


def test_an_ssw06_is_reset_by_the_edge_of_a_masked_bit_and_then_silent_while_it_restarts() -> None:
    procedure = built("ssw06", "reset", VB01=FAULT, VB03=0)

    assert words(procedure) == [(5003, 0x8000), (5003, 0x8080)]
    assert [step.is_silence_expected for step in procedure.steps[-2:]] == [False, True]
    assert procedure.verify is not None
    assert procedure.verify.within_s > load_profile("ssw06").timing.restart_s


def test_the_general_enable_of_an_ssw06_leaves_every_other_bit_alone() -> None:
    assert words(built("ssw06", "general_enable", ON)) == [(5003, 0x0202)]
    assert words(built("ssw06", "general_enable", OFF)) == [(5003, 0x0200)]


# SST: coils (ST-09, ST-19)


def test_an_sst_is_started_stopped_and_reset_by_coils_of_their_number_less_one() -> None:
    assert frames("sst", "start") == ["01 05 00 00 FF 00 8C 3A"]
    assert frames("sst", "stop") == ["01 05 00 00 00 00 CD CA"]
    assert frames("sst", "reset", COIL1=0, R19=0) == ["01 05 00 02 FF 00 2D FA"]


def test_the_start_of_an_sst_demands_its_configuration_and_the_serial_line() -> None:
    assert {"configured", "is_ready", "serial_controls"} <= set(prepared("sst", "start").requires)


# A run command that still stands


@pytest.mark.parametrize("status", [RUNNING | FAULT, ACCELERATING | FAULT], ids=["running", "accelerating"])
def test_a_motor_that_runs_is_not_reset_since_run_0_would_stop_it(status: int) -> None:
    with pytest.raises(CommandError, match="motor_running"):
        built("ssw07", "reset", VB01=status, VB03=0x13)


def test_a_general_disable_needs_no_reading_on_a_starter_with_single_bits() -> None:
    assert prepared("ssw06", "general_enable", OFF).reads == ()
    assert frames("ssw07", "general_enable", OFF, VB01=READY, VB03=0x13) == ["01 05 00 65 00 00 DD D5"]


# Preparation


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("args", [{}, {"parameter": "nonsense"}])
def test_a_stop_reads_nothing_and_demands_nothing_whatever_comes_with_it(family: str, args: Any) -> None:
    assert prepared(family, "stop", args, NO_SLOT) == Preparation(reads=(), requires=())
    assert built(family, "stop", args, variant=NO_SLOT).steps


@pytest.mark.parametrize(
    ("family", "reads"),
    [
        ("ssw07", [("01 03 13 89 00 01 51 64", ("VB01",))]),
        ("ssw06", [("01 03 13 89 00 01 51 64", ("VB01",)), ("01 03 13 8E 00 01 E0 A5", ("VB06",))]),
        ("ssw900", [("01 03 02 A8 00 06 45 90", ("S5.1.1", "S5.2.5"))]),
    ],
)
def test_a_start_reads_the_status_freshly_in_few_requests(family: str, reads: list[Any]) -> None:
    assert [(frame(read.request), read.codes) for read in prepared(family, "start").reads] == reads


@pytest.mark.parametrize("family", FAMILIES)
def test_a_start_demands_a_ready_starter_without_fault(family: str) -> None:
    assert {"no_fault", "is_ready"} <= set(prepared(family, "start").requires)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_reset_demands_a_fault_and_standstill(family: str) -> None:
    rules = ("has_fault", "is_stopped")

    assert prepared(family, "reset").requires == (("serial_controls", *rules) if family == "sst" else rules)


# Arguments


@pytest.mark.parametrize("value", [True, 1, "on", "TRUE", "1"])
def test_a_switch_is_on_in_several_spellings(value: object) -> None:
    assert frames("ssw07", "general_enable", {"value": value}) == ["01 05 00 65 FF 00 9C 25"]


@pytest.mark.parametrize("value", [False, 0, "off", "False", "0"])
def test_a_switch_is_off_in_several_spellings(value: object) -> None:
    assert frames("ssw07", "general_enable", {"value": value}) == ["01 05 00 65 00 00 DD D5"]


@pytest.mark.parametrize(
    ("verb", "args", "text"),
    [
        ("start", {"now": True}, "now is unknown"),
        ("general_enable", {}, "value is missing"),
        ("general_enable", {"value": "maybe"}, "value must be true or false"),
        ("read", {}, "parameter is missing"),
        ("read", {"parameter": 3}, "parameter must be a text"),
        ("set", {"parameter": "P314", "valu": 1}, "value is missing, valu is unknown"),  # codespell:ignore
    ],
)
def test_wrong_arguments_are_named(verb: str, args: dict[str, Any], text: str) -> None:
    error = refusal("ssw07", verb, args)

    assert error.code == "bad_arguments"
    assert text in error.text


# Verification


@pytest.mark.parametrize("family", FAMILIES)
def test_a_start_counts_as_done_once_the_motor_runs_or_accelerates(family: str) -> None:
    verify = built(family, "start", S5_2_5=0x12).verify

    assert verify is not None
    assert verify.reads
    assert verify.is_met({"running": True, "accelerating": False})
    assert verify.is_met({"running": False, "accelerating": True})
    assert not verify.is_met({"running": False, "accelerating": False})
    assert not verify.is_met({})


@pytest.mark.parametrize("bit", [3, 12])  # the initial test, the time before a start
def test_a_start_of_an_ssw900_counts_as_done_once_it_is_about_to_start(bit: int) -> None:
    verify = build(
        load_profile("ssw900"), SLOT_1, "start", {}, seen={"S5.1.1": (0x0102,), "S5.2.5": (0x12,)}
    ).verify

    assert verify is not None
    assert verify.is_met({"running": False, f"s5_1_1_{bit}": True})
    assert not verify.is_met({"running": False, f"s5_1_1_{bit}": False})


@pytest.mark.parametrize("family", FAMILIES)
def test_a_stop_counts_as_done_once_the_motor_ramps_down(family: str) -> None:
    verify = built(family, "stop").verify

    assert verify is not None
    assert verify.is_met({**NOT_STARTING, "running": True, "decelerating": True, "jog": False})
    assert verify.is_met({**NOT_STARTING, "decelerating": False, "jog": False})
    if family != "sst":  # which cannot
        assert not verify.is_met({**NOT_STARTING, "decelerating": True, "reversing": True, "jog": False})
    assert not verify.is_met({**NOT_STARTING, "running": True, "decelerating": False, "jog": False})
    assert not verify.is_met({**NOT_STARTING, "running": None, "jog": False})


def test_a_reset_counts_as_done_only_when_the_fault_is_gone() -> None:
    verify = built("ssw07", "reset").verify

    assert verify is not None
    assert verify.is_met({"fault": False, "running": False})
    assert not verify.is_met({"fault": True, "running": False, "accelerating": True})
    assert not verify.is_met({"fault": False, "running": True})


@pytest.mark.parametrize("about_to_start", ["s5_1_1_3", "s5_1_1_12"])
@pytest.mark.parametrize(("verb", "args"), [("stop", {}), ("general_enable", ON)])
def test_an_ssw900_that_is_about_to_start_does_not_stand(
    verb: str, args: dict[str, Any], about_to_start: str
) -> None:
    """Initial test and time before start (S5.1, C5.7.1): it does not run yet, and will."""
    verify = built("ssw900", verb, args, S5_1_1=0x0102, S5_2_5=0x0012).verify
    at_rest = {**NOT_STARTING, "general_enabled": True, "jog": False}

    assert verify is not None
    assert verify.is_met(at_rest)
    assert not verify.is_met({**at_rest, about_to_start: True})


def test_a_command_without_a_point_to_look_at_has_no_verification() -> None:
    profile = load_profile("ssw07")
    start = profile.commands["start"].model_copy(update={"verify": None})
    blind = profile.model_copy(update={"commands": {**profile.commands, "start": start}})

    assert build(blind, SLOT_1, "start", {}, seen={}).verify is None
