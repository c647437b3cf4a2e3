"""Commands in tables: what each reads and demands, what it writes, what counts as done, what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families.command.procedures import build, verbs
from gateway.families.profile.arguments import MOST
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.procedure import Preparation
from gateway.modbus.writes import MaskWriteRegister
from tests.families.notation import built, command, prepared, reads, refusal, rows, said, shown, writes

WEG = ("ssw06", "ssw07", "ssw900")
REST, FAULT = "VB01=0x4102 VB03=0", "VB01=0x8000 VB03=0"  # enabled, remote, supplied; at rest
REST_900 = "S5.1.1=0x0102 S5.2.5=0x12"
REST_SST = "COIL1=0 R19=0"

WRITES = [  # each verb as it is, on the wire: tests/scenarios/commands/test_verbs.py
    # the SSW-07 by single coils (S7-02)
    ("ssw07", "output RL1=True", "VB08=0", "5008:0001"),
    # the SSW-06 by a masked word (S6-02, S6-03)
    ("ssw06", "stop", "VB01=0x4106", "5003:0100 5003:0400"),
    ("ssw06", "direction forward", REST, "5003:0800"),
    ("ssw06", "configure leave=p202", "VB06=2 " + REST, "5007:0002"),
    # relays and analog outputs (S6-12, S6-13, S9-22): no other bit changes; 16383 or 1023 are 100 %
    ("ssw06", "output RL1=True", "VB08=0b100", "5008:0005"),
    ("ssw06", "output RL3='off'", "VB08=0b111", "5008:0003"),
    ("ssw06", "output rl2=1", "VB08=0xFFF8", "5008:0002"),
    ("ssw06", "output AO1=50", "", "5009:1FFF"),  # ssw06-es 5.4.6
    ("ssw06", "output AO2=25", "", "5010:0FFF"),
    ("ssw900", "output AO1=100", "", "696:03FF"),
    ("ssw900", "output AO1=50", "", "696:01FF"),
    ("ssw900", "output DO2=False", "S5.3.1=0b111", "695&FFFD|0000"),
    # the SST by coils of their number less one (ST-02, ST-09, ST-19), registers only in its mode (ST-10)
    ("sst", "configure R41=30 r33=2.0", "R41=30 R33=5 " + REST_SST, "c1:1 33:0014 c1:0"),
    ("sst", "configure R41=30 r33=2.0", "R41=0 R33=5 " + REST_SST, "c1:1 41:001E 33:0014 c1:0"),
    ("sst", "configure R41=30 r33=2.0", "R41=30 R33=20 " + REST_SST, "c1:1 c1:0"),
    ("sst", "configure R41=30", "R41=0x011E " + REST_SST, "c1:1 c1:0"),  # only the low byte decides
    ("sst", "set R41=30 R33=2.0", "R41=0 R33=0 " + REST_SST, "c1:1 41:001E 33:0014 c1:0"),
    # the SSW900 changes its bit in the last word (S9-07): no mask; reserved bits stay 0
    ("ssw900", "start", "S5.2.5=0x9A", "685:001B"),  # the reset bit goes
    ("ssw900", "start", "S5.2.5=0xFF72", "685:0013"),
    ("ssw900", "stop", "S5.2.5=0x16", "685:0012"),  # a jog stops too
    ("ssw900", "stop", "S5.2.5=0", "685:0000"),
    ("ssw900", "stop", "S5.1.1=0x0106 S5.2.5=0x16", "685:0012"),
    ("ssw900", "reset", "S5.2.5=0x13", "685:0012 685:0092"),  # only at standstill: never with run
    ("ssw900", "reset", "S5.2.5=0x92", "685:0012 685:0092"),
    ("ssw900", "jog off", "S5.1.1=0x0103 S5.2.5=0x17", "685:0013"),  # the motor runs on
    ("ssw900", "direction forward", "S5.1.1=0x0902 S5.2.5=0x12", "685:0012"),
    ("ssw900", "local_remote remote", "S5.1.1=0x0002 S5.2.5=0x12", "685:0012"),
    ("ssw900", "local_remote local", REST_900, "685:0002"),
    # in slot 2 the other word (S9-06, S9-21), and both while a stop does not know the slot
    ("ssw900", "jog on", "slot=2 S5.1.1=0x0102 S5.2.6=0x12", "686:0016"),
    ("ssw900", "stop", "slot=0 S5.2.6=0x1B", "685&FFFA|0000 686:001A"),
    # what the device hides of its word is taken from its status: enable, remote, direction (S9-08)
    ("ssw900", "start", "S5.2.5=0 S5.1.1=0x0102", "685:0013"),
    ("ssw900", "start", "S5.2.5=8 S5.1.1=0x0102", "685:0013"),
    ("ssw900", "start", "S5.2.5=0x12 S5.1.1=0x0902", "685:001B"),
    ("ssw900", "start", "S5.1.1=0x0102", "685:0013"),  # the status alone is enough
    ("ssw900", "reset", "S5.2.5=0x12 S5.1.1=0x8000", "685:0000 685:0080"),
    ("ssw900", "general_enable off", "S5.2.5=0x13 S5.1.1=0x0102", "685:0010"),  # the motor does not obey it
    ("ssw900", "general_enable off", "S5.2.5=0x13 S5.1.1=0x0103", "685:0011"),
    ("ssw900", "general_enable off", "S5.2.5=0x13 S5.1.1=0x0112", "685:0011"),  # accelerating
    ("ssw900", "general_enable off", "S5.2.5=0x06 S5.1.1=0x0006", "685:0004"),
    ("ssw900", "general_enable off", "S5.2.5=0x06 S5.1.1=0x0002", "685:0000"),
    # of which nothing is known, run and jog are cleared by mask
    ("ssw900", "stop", "", "685&FFFA|0000"),
    ("ssw900", "jog off", "", "685&FFFB|0000"),
    # rows: once, only what differs, neighbours in one request, low word first
    ("ssw07", "set P314=30 P313=1 P229=2", "P314=0 P313=0 P229=0 " + REST, "229:0002 313:0001,001E"),
    ("ssw07", "set P314=30 P313=1", "P314=30 P313=0", "313:0001"),
    ("ssw900", "set C11.3.1=10000", "", "1110:2710,0000"),
    ("ssw900", "set C8.2.5.1=2", "C8.2.5.1=0 C8.2.5.3=50", "740:0002"),
    ("ssw900", "set C8.2.5.1=0", "C8.2.5.1=1", "740:0000"),
    ("ssw900", "set C8.2.5.3=0.0", "C8.2.5.1=0 C8.2.5.3=50", "734:0000"),
    ("ssw900", "set C8.2.5.3=5.0", "C8.2.5.1=1", "734:0032"),
    # a text in the byte order in which it was read, which no manual states
    ("ssw900", "set C8.6.3=Pump", "C8.6.3=0x4661,0x6E00,0,0,0,0,0,0", "808:5075,6D70" + ",0000" * 6),
    ("ssw900", "set C8.6.3=Pump", "C8.6.3=0x6146,0x006E,0,0,0,0,0,0", "808:7550,706D" + ",0000" * 6),
    ("ssw900", "set S5.6.2=1", "S5.6.2=0", "693:0001"),  # aborts a start-up
]


@pytest.mark.parametrize(("family", "text", "known", "expected"), WRITES)
def test_a_command_writes(family: str, text: str, known: str, expected: str) -> None:
    assert writes(family, text, known) == expected


CLOCK = "set C6.3.1=2026-12-31T23:59:58"
STARTING = "running=0 reversing=0 s5_1_1_3=0 s5_1_1_12=0"  # and not about to start, of an SSW900
MET = [  # a command, what is seen afterwards, whether it counts as done
    *[
        row
        for family in FAMILIES
        for row in (
            (family, "start", "S5.2.5=0x12", "running=1 accelerating=0", True),
            (family, "start", "S5.2.5=0x12", "running=0 accelerating=1", True),
            (family, "start", "S5.2.5=0x12", "running=0 accelerating=0", False),
            (family, "start", "S5.2.5=0x12", "", False),
            (family, "stop", "", STARTING + " running=1 decelerating=1 jog=0", True),
            (family, "stop", "", STARTING + " decelerating=0 jog=0", True),
            (family, "stop", "", STARTING + " running=1 decelerating=0 jog=0", False),
            (family, "stop", "", STARTING + " running=? jog=0", False),
        )
    ],
    *[
        row
        for family in WEG
        for row in (
            (family, "stop", "", STARTING + " decelerating=1 reversing=1 jog=0", False),
            (family, "stop", "", STARTING + " jog=0", True),
            (family, "stop", "", STARTING + " jog=1", False),
            *[
                (family, text, "S5.1.1=0x0102", f"{STARTING} {point}={value}", (value == 1) is becomes)
                for text, point, becomes in (
                    ("jog on", "jog", True),
                    ("jog off", "jog", False),
                    ("direction Reverse", "reverse", True),
                    ("direction forward", "reverse", False),
                    ("local_remote remote", "remote", True),
                    ("local_remote local", "remote", False),
                )
                for value in (1, 0)
            ],
        )
    ],
    ("ssw07", "stop", "firmware=1.30", "running=0 jog=1", True),  # a bit that it does not have
    *[
        (f, t, "S5.1.1=0x0102 S5.2.5=0x12", f"{STARTING} general_enabled=1 jog=0 {bit}=1", False)
        for f, t in (("ssw900", "stop"), ("ssw900", "general_enable on"))
        for bit in ("s5_1_1_3", "s5_1_1_12")  # initial test, time before start: it does not run yet, and will
    ],
    ("ssw900", "general_enable on", REST_900, STARTING + " general_enabled=1 jog=0", True),
    ("ssw900", "start", REST_900, "running=0 s5_1_1_3=1", True),
    ("ssw900", "start", REST_900, "running=0 s5_1_1_3=0", False),
    ("ssw900", "start", REST_900, "running=0 s5_1_1_12=1", True),
    ("ssw07", "reset", "", "fault=0 running=0", True),
    ("ssw07", "reset", "", "fault=1 running=0 accelerating=1", False),
    ("ssw07", "reset", "", "fault=0 running=1", False),
    ("ssw06", "configure leave=P202", "VB06=2 " + REST, "VB06=0 running=0", True),
    ("ssw06", "configure leave=P202", "VB06=2 " + REST, "VB06=1 running=0", True),
    ("ssw06", "configure leave=P202", "VB06=2 " + REST, "VB06=2 running=0", False),
    ("ssw06", "configure leave=P202", "VB06=2 " + REST, "VB06=0 running=1", False),
    ("sst", "configure R41=30 R33=2.0", "R41=0 R33=0 " + REST_SST, "R41=0x0A1E R33=20 running=0", True),
    ("sst", "configure R41=30 R33=2.0", "R41=0 R33=0 " + REST_SST, "R41=30 R33=21 running=0", False),
    ("sst", "configure R41=30 R33=2.0", "R41=0 R33=0 " + REST_SST, "R41=30 running=0", False),
    ("sst", "configure", REST_SST, "COIL5=1 running=0", True),
    ("sst", "reset whole", REST_SST, "configured=0 running=0", True),
    ("ssw06", "output RL2=True", "VB08=0", "VB08=6", True),
    ("ssw06", "output RL2=True", "VB08=0", "VB08=5", False),
    ("ssw06", "output AO1=50", "", "VB09=8191", True),
    ("ssw06", "output AO1=50", "", "VB09=8190", False),
    *[  # a clock goes on, in the byte order in which it was read
        ("ssw900", CLOCK, f"C6.3.1={before}", f"C6.3.1={after}", is_met)
        for before, written, later in (
            ("0x1E00,0x1605,11,2026", "0x3B3A,0x1F17,12,2026", "0,0x0100,1,2027"),
            ("0x001E,0x0516,0x0B00,0xEA07", "0x3A3B,0x171F,0x0C00,0xEA07", "0,0x0001,0x0100,0xEB07"),
        )
        for after, is_met in ((written, True), (later, True), (before, False))
    ],
    (
        "ssw900",
        "set S5.6.2=1",
        "S5.6.2=0",
        "S5.6.1=1 " + STARTING,
        True,
    ),  # aborts a start-up: seen by the status
    ("ssw900", "set S5.6.2=1", "S5.6.2=0", "S5.6.1=4 " + STARTING, False),
    ("ssw07", "set P314=5", "P314=0", "P314=5", True),
    ("ssw07", "set P314=5", "P314=0", "P314=0", False),
    ("ssw07", "set P314=5", "P314=0", "", False),
    ("ssw07", "set P314=30 P313=1", "P314=30 P313=0", "P314=30 P313=1", True),
    ("ssw07", "set P314=30 P313=1", "P314=30 P313=0", "P314=29 P313=1", False),
    ("ssw07", "set P314=30 P313=1", "P314=30 P313=0", "P313=1", False),
]


def test_a_command_counts_as_done_once_the_starter_shows_it() -> None:
    for family, text, known, seen, is_met in MET:
        verify = built(family, text, known).verify
        assert verify is not None
        assert verify.reads
        assert verify.is_met(rows(seen)[1]) is is_met, (family, text, known, seen)


READS = [  # what is read freshly, and demanded of it
    ("ssw07", "start", "h5001*1=VB01", None),
    ("ssw06", "start", "h5001*1=VB01 h5006*1=VB06", None),
    ("ssw900", "start", "h680*6=S5.1.1,S5.2.5", None),
    ("ssw06", "general_enable off", "", None),
    ("ssw900", "jog off", "h680*6=S5.1.1,S5.2.5", ""),
    ("ssw07", "reset", "h5001*1=VB01", "has_fault is_stopped"),
    ("sst", "reset whole", None, "serial_controls is_stopped"),
    ("ssw06", "configure leave=P202", None, "is_stopped"),
    ("sst", "configure R33=2.0", "c4*4=COIL5,COIL7,COIL8 i19*1=R19 i33*1=R33", "serial_controls is_stopped"),
    ("sst", "set R33=2.0", "c4*4=COIL5,COIL7,COIL8 i19*1=R19 i33*1=R33", "serial_controls is_stopped"),
    ("ssw06", "output RL1=True", "h277*1=P277 h5008*1=VB08", None),
    ("ssw07", "read p003", "h3*1=P003", ""),
    ("ssw900", "read S1.1.4", "h24*2=S1.1.4", ""),
    ("ssw07", "read P003 p002 P003", "h2*2=P002,P003", ""),
    ("ssw07", "read P002 P003 P004 P005", "h2*2=P002,P003 h4*1=P004 h5*1=P005", ""),  # not vouched for: alone
    ("ssw07", "set P314=5", "h314*1=P314", ""),
    ("ssw900", "set C8.2.5.1=2", "h734*7=C8.2.5.3,C8.2.5.1", ""),
    ("ssw900", "set C8.2.5.3=5.0 C8.1.1.5=680", None, "is_stopped"),  # one Stopped row among others
    ("ssw900", "set C8.2.5.3=5.0 C11.3.1=1", None, ""),
    ("ssw900", "set S5.6.2=1", None, "is_stopped"),
    ("ssw900", "set C8.1.1.5=680", "h680*1=S5.1.1 h1300*1=C8.1.1.5", "is_stopped"),
    *[("ssw07", f"set {code}=1", None, "is_stopped") for code in ("P220", "P229", "P230")],
]


@pytest.mark.parametrize(("family", "text", "asked", "requires"), READS)
def test_a_command_reads_and_demands(family: str, text: str, asked: str | None, requires: str | None) -> None:
    preparation = prepared(family, text)

    assert asked in (None, reads(preparation))
    assert requires in (None, " ".join(preparation.requires))


@pytest.mark.parametrize("family", FAMILIES)
def test_what_starts_demands_a_ready_starter_and_what_ends_demands_nothing(family: str) -> None:
    for known in ("slot=0", "slot=0 firmware=1.30"):
        for text in ("stop", "stop parameter=nonsense"):
            assert prepared(family, text, known) == Preparation(reads=(), requires=())
            assert built(family, text, known).steps
    start = prepared(family, "start")
    assert {"no_fault", "is_ready"} <= set(start.requires)
    if family == "sst":
        assert {"configured", "serial_controls"} <= set(start.requires)
        assert prepared(family, "reset").requires == ("serial_controls", "has_fault", "is_stopped")
        return
    assert prepared(family, "jog on") == start
    assert prepared(family, "jog off", "slot=0").requires == ()
    assert built(family, "jog off", "slot=0").steps
    assert "is_stopped" in prepared(family, "direction forward").requires
    assert "is_stopped" in prepared(family, "direction reverse").requires
    assert prepared(family, "reset").requires == ("has_fault", "is_stopped")


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_the_verbs_of_its_manual_and_no_other(family: str) -> None:
    own = set(verbs(load_profile(family)))

    assert {"start", "stop", "reset", "read", "set"} <= own
    assert ("configure" in own) == (family in ("sst", "ssw06"))
    assert len({"general_enable", "jog", "direction", "local_remote", "output"} & own) == 5 * (
        family != "sst"
    )
    for verb in ("general_enable_off", "jog_off", "reset_whole", "explode", ""):
        assert refusal(family, verb, {}).code == "unknown_verb"
        with pytest.raises(CommandError, match="unknown_verb"):
            build(load_profile(family), rows("")[0], verb, {}, seen={})


REFUSED = [  # before anything is read
    ("ssw07", "configure", {}, "unknown_verb", ""),
    ("ssw07", "reset", {"whole": True}, "bad_arguments", "whole is unknown"),
    ("ssw06", "local_remote", {"value": "up"}, "bad_arguments", "remote, local"),
    ("ssw07", "read", {"parameter": 3}, "bad_arguments", "parameter must be a text"),
    ("ssw07", "read", {"parameters": []}, "bad_arguments", ""),
    ("ssw07", "read", {"parameters": 3}, "bad_arguments", ""),
    ("ssw07", "read", {"parameters": ["P002", 3]}, "bad_arguments", ""),
    ("ssw07", "read", {"parameters": ["P002"], "parameter": "P003"}, "bad_arguments", ""),
    ("ssw07", "read", {"parameters": ["P002"] * (MOST + 1)}, "bad_arguments", ""),
    ("ssw07", "read", {"parameters": ["P002", "X1"]}, "unknown_parameter", ""),
    ("ssw07", "read", {"parameters": ["P002", "P200"]}, "not_readable", ""),
    ("ssw06", "read", {"parameter": "P200"}, "not_readable", ""),
    ("sst", "read", {"parameter": "P003"}, "unknown_parameter", ""),
    ("ssw07", "set", {"parameters": {}}, "bad_arguments", ""),
    ("ssw07", "set", {"parameters": ["P314"]}, "bad_arguments", ""),
    ("ssw07", "set", {"parameters": "P314"}, "bad_arguments", ""),
    ("ssw07", "set", {"parameters": {"P314": 1}, "value": 1}, "bad_arguments", ""),
    ("ssw07", "set", {"parameters": {"P314": 1, "p314": 2}}, "bad_arguments", ""),
    ("ssw07", "set", {"parameters": {"P314": 1, "P003": 1}}, "not_writable", ""),
    ("ssw07", "set", {"parameters": {"P314": 1, "P313": 9}}, "out_of_range", ""),
    ("ssw07", "set", {"parameters": {"P314": 1, "P308": 9}}, "would_cut_connection", ""),
    # commands and the connection: tests/rules/test_x_rules.py, X-05
    ("ssw900", *command("set C8.2.1=2"), "would_cut_connection", ""),
    *[
        (f, *command(f"set {code}=1"), "not_writable", "")
        for f, code in (("ssw06", "VB03.0"), ("ssw900", "S5.2.1"))
    ],
    *[
        ("ssw900", *command(f"set {code}=1"), "not_writable", "is an action, no setting")
        for code in ("C10.1.1", "C10.2.1", "C10.3.1", "C10.4.1", "C10.5.1", "A1.1")
    ],
    ("sst", *command("set COIL5=1"), "not_writable", "COIL5 is read-only"),
    ("sst", *command("set COIL1=1"), "not_writable", "the verbs of the family"),
    ("ssw900", *command("set HR1600=1"), "not_writable", "no parameter of the manual"),
    ("ssw900", *command("set C8.6.2=123456"), "not_writable", "how its characters lie"),
    ("ssw06", *command("set P000=1"), "not_writable", "needs no password"),
    ("ssw07", *command("set P000=1"), "not_writable", "needs no password"),
    ("ssw06", *command("set P200=1"), "not_writable", "not accessible through serial"),
    ("ssw07", *command("set P215=1"), "not_writable", "not accessible through serial"),
    ("ssw900", *command("set C8.2.5.1=99"), "out_of_range", "0 (Inactive), 1 ("),
    ("ssw900", *command("set C8.2.5.1=Sometimes"), "bad_value", "0 (Inactive), 1 ("),
    *[
        ("ssw06", "configure", args, "bad_arguments", "")
        for args in ({}, {"leave": "both"}, {"leave": 1}, {"leave": "P202", "R41": 1})
    ],
    ("sst", "configure", {"R41": 30, "r41": 31}, "bad_arguments", ""),
    ("sst", "configure", {"R12": 30}, "bad_arguments", ""),
    ("sst", "configure", {"COIL1": 1}, "bad_arguments", ""),
    ("sst", "configure", {"R99": 30}, "unknown_parameter", ""),
    ("sst", "configure", {"R41": 256}, "out_of_range", ""),
    ("sst", "configure", {"R41": "soon"}, "bad_value", ""),
    ("ssw06", *command("output RL1=50"), "bad_value", "true or false"),
    ("ssw06", *command("output AO1=True"), "bad_value", "0 to 100 %"),
    ("ssw06", *command("output AO1=half"), "bad_value", "0 to 100 %"),
    ("ssw06", *command("output AO1=100.1"), "out_of_range", "0 to 100 %"),
    ("ssw06", *command("output AO1=-1"), "out_of_range", "0 to 100 %"),
    ("ssw06", "output", {"output": "RL1"}, "bad_arguments", "value is missing"),
]


@pytest.mark.parametrize(("family", "verb", "args", "code", "text"), REFUSED)
def test_a_command_is_refused_before_anything_is_read(
    family: str, verb: str, args: dict[str, Any], code: str, text: str
) -> None:
    error = refusal(family, verb, args)

    assert error.code == code
    assert text in error.text


REFUSED_AFTERWARDS = [  # for what was read
    ("ssw06", "configure leave=factory", "VB06=2", "not_in_that_mode"),
    ("ssw06", "configure leave=P202", "VB06=1", "not_in_that_mode"),
    ("ssw06", "output RL1=True", "", "word_unknown"),
    ("ssw900", "start", "", "word_unknown"),
    *[("ssw900", t, "slot=0 S5.2.5=0x12", "slot_unknown") for t in ("start", "reset", "general_enable on")],
    ("ssw07", "reset", "VB01=0x8001 VB03=0x13", "motor_running"),  # run = 0 would stop it
    ("ssw07", "reset", "VB01=0x8008 VB03=0x13", "motor_running"),
    *[
        ("ssw900", text, known, "timeout_unset")
        for text, known in (
            ("set C8.2.5.1=2", "C8.2.5.1=0"),
            ("set C8.2.5.1=2", "C8.2.5.1=0 C8.2.5.3=0"),
            ("set C8.2.5.3=0.0", "C8.2.5.3=50"),
            ("set C8.2.5.3=0.0", "C8.2.5.3=50 C8.2.5.1=1"),
            ("set C8.2.5.1=2 C8.2.5.3=0.0", "C8.2.5.1=1 C8.2.5.3=50"),
            ("set C8.2.5.1=0 C8.2.5.3=0.0", "C8.2.5.1=1 C8.2.5.3=50"),
        )
    ],
    *[
        (family, "local_remote local", f"{row}={n} {rest}", None if n in own else "not_set_to_serial")
        for family, row, rest, last, own in (
            ("ssw06", "P220", REST, 10, (5, 6)),
            ("ssw07", "P220", REST, 8, (5, 6)),
            ("ssw900", "C3.1", REST_900, 12, (9, 10, 11, 12)),
        )
        for n in range(last + 1)
    ],
    *[
        ("ssw900", f"output {o}", f"{code}=1", "not_set_to_serial")
        for o, code in (("DO1=True", "C4.2.1"), ("DO3=True", "C4.2.3"), ("AO1=50", "C4.3.1"))
    ],
    ("ssw900", "output DO1=True", "C4.2.1=12", None),
    ("ssw900", "output AO1=50", "C4.3.1=9", None),
]


@pytest.mark.parametrize(("family", "text", "known", "code"), REFUSED_AFTERWARDS)
def test_a_command_is_refused_for_what_was_read(family: str, text: str, known: str, code: str | None) -> None:
    if code is None:
        assert built(family, text, known).steps
        return
    with pytest.raises(CommandError) as caught:
        built(family, text, known)
    assert caught.value.code == code


@pytest.mark.parametrize("text", ["jog on", "direction forward", "direction reverse"])
def test_an_ssw07_before_v1_40_neither_jogs_nor_turns_the_other_way(text: str) -> None:
    error = refusal("ssw07", *command(text), known="firmware=V1.32")

    assert (error.code, "from firmware 1.40; this starter has V1.32" in error.text) == (
        "not_in_firmware",
        True,
    )
    assert prepared("ssw07", text, "firmware=V1.4x").reads
    assert prepared("ssw07", text).reads


@pytest.mark.parametrize("word", [0x0000, 0x0010, 0x0002, 0x001A, 0xFFFA])
def test_a_stop_of_which_nothing_is_known_clears_run_and_jog_and_nothing_else(word: int) -> None:
    (step,) = built("ssw900", "stop").steps

    assert isinstance(step.request, MaskWriteRegister)
    assert {step.request.apply(word | motion) for motion in (0, 1, 4, 5)} == {word}


@pytest.mark.parametrize("value", [True, 1, "on", "TRUE", "1", False, 0, "off", "False", "0"])
def test_a_switch_is_on_or_off_in_several_spellings(value: object) -> None:
    is_on = str(value).casefold() in ("true", "1", "on")
    procedure = build(load_profile("ssw07"), rows("")[0], "general_enable", {"value": value}, seen={})

    assert shown(procedure.steps[-1].request) == f"c101:{int(is_on)}"


def test_a_device_that_restarts_is_given_time_and_may_be_silent() -> None:
    for family, text, known in (
        ("ssw06", "reset", FAULT),
        ("ssw06", "configure leave=P202", "VB06=2 " + REST),
        ("sst", "reset whole", REST_SST),
    ):
        procedure = built(family, text, known)
        assert procedure.steps[-1].is_silence_expected
        assert not any(step.is_silence_expected for step in procedure.steps[:-1])
        assert procedure.verify is not None
        assert procedure.verify.within_s > load_profile(family).timing.restart_s
    assert "configure" in said(built("sst", "reset whole", REST_SST))


def test_each_step_of_the_sst_is_seen_before_the_next_and_the_mode_is_left_when_one_failed() -> None:
    procedure = built("sst", "configure R41=30", "R41=0 " + REST_SST)
    _, enter, write, leave = procedure.steps

    assert enter.then is not None
    assert enter.then.is_met({"COIL2": (1,)})
    assert not enter.then.is_met({"COIL2": (0,)})
    assert write.then is None
    assert leave.then is not None
    assert leave.then.is_met({"COIL5": (1,)})
    assert leave.then.within_s == 5.0
    for text in ("configure", "set R41=30"):
        assert [shown(request) for request in built("sst", text, REST_SST).abandon] == ["c1:0"]


def test_the_time_of_a_timeout_is_seen_before_it_is_made_active() -> None:
    time, mode = built("ssw900", "set C8.2.5.1=2 C8.2.5.3=5.0", "C8.2.5.1=0 C8.2.5.3=0").steps

    assert time.then is not None
    assert time.then.is_met({"C8.2.5.3": (50,)})
    assert not time.then.is_met({"C8.2.5.3": (0,)})
    assert mode.then is None


SUBJECTS = [  # what the result names, and how much non-volatile memory wears
    ("ssw07", "read P003 p002 P003", "", "P003 P002", 0),
    ("ssw07", "set P314=30 P313=1 P229=2", "P314=0 P313=0 P229=0 " + REST, "P314 P313 P229", 3),
    ("ssw07", "set P314=30 P313=1", "P314=30 P313=0", "P314 P313", 1),
    ("ssw06", "set VB08=1", "", "", 0),
    ("ssw900", "set S5.3.1=1", "", "", 0),
    ("ssw900", "set S5.6.2=1", "S5.6.2=0", "", 0),
    ("ssw06", "set P314=1", "", "", 1),
    ("sst", "set R41=30 R33=2.0", "R41=0 R33=0 " + REST_SST, "R41 R33", 1),
]


def test_a_result_names_its_rows_and_what_wears() -> None:
    found = [(f, t, k, " ".join(built(f, t, k).subjects), built(f, t, k).wears) for f, t, k, _, _ in SUBJECTS]

    assert found == SUBJECTS
    assert [built("ssw07", text).subject for text in ("read p003", "set P314=5")] == ["P003", "P314"]
    assert built("sst", "set R41=30", "R41=0 " + REST_SST).subject == "R41"
    for family, text, known in (
        ("ssw07", "set P314=5", "P314=5"),
        ("ssw07", "set P314=30 P313=1", "P314=30 P313=1"),
        ("sst", "set R41=30", "R41=30 " + REST_SST),
        ("ssw06", "output RL2=True", "VB08=2"),
    ):
        assert (built(family, text, known).is_unchanged, built(family, text, known).steps) == (True, ())


@pytest.mark.parametrize("family", WEG)
def test_a_command_that_gives_the_control_away_says_so(family: str) -> None:
    known = REST_900 if family == "ssw900" else REST

    assert "not even a stop" in said(built(family, "local_remote local", known))
    assert "not even a stop" not in said(built(family, "local_remote remote", known))


def test_where_the_number_of_the_option_is_not_printed_the_result_says_what_it_does_not_prove() -> None:
    note = said(built("ssw07", "output RL1=True", "VB08=0 P277=3"))

    assert "RL1 follows VB08 only if P277 (relay RL1 function) is set to Serial, and P277 reads 3" in note
    assert "reads" not in said(built("ssw06", "output AO1=5"))
    assert said(built("ssw900", "output DO1=True")) == ""
    with pytest.raises(CommandError, match=r"C4\.2\.1 is 1 \(.+\), not 12 \("):
        built("ssw900", "output DO1=True", "C4.2.1=1")
