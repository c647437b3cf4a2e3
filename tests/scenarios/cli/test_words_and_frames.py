"""`decode` and `encode`, against the telegrams and tables of the manuals."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenarios.cli.lines import LineRow, line_row, play_line

DECODE = [
    line_row(
        "P002 and P003 of the manual's example are 50 % and 40 A",  # SSW-07 5.4.2, SSW-06 5.4.2
        "decode ssw07 holding 2 500 400",
        json={
            "P002/value": 50.0,
            "P002/unit": "%",
            "P002/point": "current_pct",
            "P003/value": 40.0,
            "P003/unit": "A",
            "P003/raw": [400],
        },
    ),
    line_row(
        "the first word may be given by its code",
        "decode ssw07 holding P002 0x01F4 0x0190",
        json={"P002/value": 50.0, "P003/value": 40.0},
    ),
    line_row(
        "without its model the current of an SSW-06 is not guessed",
        "decode ssw06 holding P003 815",
        json={"P003/value": None, "P003/raw": [815]},
    ),
    line_row(
        "a current of an SSW-06 of 820 A and more has no decimal",  # SSW-06 4.4
        "decode ssw06 holding P003 815 --model 'SSW-06 820A'",
        json={"P003/value": 815.0},
    ),
    line_row(
        "a smaller one's has one",
        "decode ssw06 holding P003 815 --model 'SSW-06 85A'",
        json={"P003/value": 81.5},
    ),
    line_row(
        "coils are bits of the status, with their meaning",  # SSW-07 5.4.1
        "decode ssw07 coil 0 0 1",
        json={
            "VB01.0/value": False,
            "VB01.0/label": "motor stopped",
            "VB01.1/value": True,
            "VB01.1/point": "general_enabled",
        },
    ),
    line_row(
        "a status word is shown bit by bit",
        "decode ssw06 holding 5001 0x0103",
        json={
            "VB01/raw": [259],
            "VB01/bits/0/point": "running",
            "VB01/bits/0/value": True,
            "VB01/bits/2/value": False,
        },
    ),
    line_row(
        "a bit that the firmware does not have means nothing",  # SSW-07 4.2.1: jog from V1.4x on
        "decode ssw07 holding 5001 0x0004 --firmware 1.30",
        json={"VB01/bits/2/point": "jog", "VB01/bits/2/value": None, "VB01/bits/2/meaning": None},
    ),
    line_row(
        "nor does its coil",
        "decode ssw07 coil 2 1 --firmware 1.30",
        json={"VB01.2/point": "jog", "VB01.2/value": None, "VB01.2/label": None},
    ),
    line_row(
        "from the firmware on that has it, it does",
        "decode ssw07 coil 2 1 --firmware 1.40",
        json={"VB01.2/value": True, "VB01.2/label": "with jog"},
    ),
    line_row(
        "a fault of an SSW-07 has its name",
        "decode ssw07 holding P014 5",
        json={"P014/label": "E05 Motor overload", "P014/point": "fault_code"},
    ),
    line_row(
        "the SSW900 gives 218.6 V",  # SSW900 7.2.4, table 7.3
        "decode ssw900 holding 4 2186",
        json={"S1.2.4/value": 218.6, "S1.2.4/unit": "V"},
    ),
    line_row(
        "and its current in two words, the low one first",
        "decode ssw900 holding 24 23 0",
        json={"S1.1.4/value": 2.3, "S1.1.4/unit": "A", "S1.1.4/raw": [23, 0]},
    ),
    line_row(
        "the SST says what its motor does",
        "decode sst input R19 2",
        json={"R19/label": "motor at speed", "R19/value": 2},
    ),
    line_row(
        "a temperature below zero is one",
        "decode sst input 13 0xFFF6",
        json={"R13/value": -10.0, "R13/unit": "°C", "R13/point": "heatsink_temperature"},
    ),
    line_row(
        "the SST's coils count from 1",
        "decode sst coil COIL5 1",
        json={"COIL5/point": "configured", "COIL5/value": True},
    ),
    line_row(
        "a code of another table is named with its own",
        "decode sst holding R19 2",
        code=2,
        out="",
        err="R19 is in the table input, not holding",
    ),
    line_row(
        "a word has 16 bits", "decode ssw07 holding 3 70000", code=2, err="70000 is out of range (0..65535)"
    ),
    line_row("a coil is 0 or 1", "decode ssw07 coil 0 2", code=2, err="2 is out of range (0..1)"),
    line_row(
        "an unknown family is answered with those that exist",
        "decode ssw99 holding 3 1",
        code=2,
        err="no family 'ssw99'; there are sst, ssw06, ssw07, ssw900",
    ),
    line_row("an unknown code has no words", "decode ssw07 holding P99999 1", code=2, err="has no 'P99999'"),
    line_row("words end at 65535", "decode ssw07 holding 65535 1 2", code=2, err="the last address is 65535"),
]

ENCODE = [
    line_row(
        "an SSW-07 starts and stops by coil 100", "encode ssw07 20 start", out="14 05 00 64 FF 00 CF 20\n"
    ),
    line_row("and stops by it", "encode ssw07 1 stop", out="01 05 00 64 00 00 8C 15\n"),
    line_row(
        "a reset is the manual's telegram, after run and jog are off",  # SSW-07 5.4.3
        "encode ssw07 1 reset",
        out="01 05 00 64 00 00 8C 15\n01 05 00 66 00 00 2D D5\n01 05 00 6B 00 00 BC 16\n"
        "01 05 00 6B FF 00 FD E6\n",
    ),
    line_row(
        "an SSW-06 starts by mask and bit of VB03", "encode ssw06 3 start", out="03 06 13 8B 01 01 3C D6\n"
    ),
    line_row("and stops by mask alone", "encode ssw06 1 stop", out="01 06 13 8B 01 00 FC F4\n"),
    line_row(
        "an SSW900 starts with the bits that are in force",
        "encode ssw900 1 start --slot 1 --last-word 0x12",
        out="01 06 02 AD 00 13 58 5E\n",
    ),
    line_row(
        "it stops by clearing them, whatever else is set",
        "encode ssw900 1 stop --slot 2",
        out="01 16 02 AE FF FA 00 00",
    ),
    line_row("an SST starts by coil 1", "encode sst 4 start", out="04 05 00 00 FF 00 8C 6F\n"),
    line_row("and stops by it as well", "encode sst 4 stop", out="04 05 00 00 00 00 CD 9F\n"),
    line_row(
        "an SST is stopped before it is configured",
        "encode sst 4 configure",
        out="04 05 00 00 00 00 CD 9F\n04 05 00 01 FF 00 DD AF\n04 05 00 01 00 00 9C 5F\n",
    ),
    line_row(
        "a setting is written alone", "encode ssw07 15 set parameter=P314 value=5", out="0F 06 01 3A 00 05"
    ),
    line_row(
        "who may command is set between two stops",
        "encode ssw07 1 local_remote value=remote",
        out=("01 05 00 64 00 00 8C 15\n", "01 05 00 68 FF 00 0D E6\n"),
    ),
    line_row("a parameter is read", "encode ssw06 1 read parameter=P002", out="01 03 00 02 00 01 25 CA\n"),
    line_row(
        "an SST's by its own function", "encode sst 4 read parameter=R13", out="04 04 00 0D 00 01 A0 5C\n"
    ),
    line_row("an SSW900 needs its slot", "encode ssw900 1 start", code=2, out="", err="--slot 1 or --slot 2"),
    line_row(
        "and, for what changes single bits, the word in force",
        "encode ssw900 1 start --slot 1",
        code=2,
        out="",
        err="give --last-word",
    ),
    line_row(
        "there are 247 addresses",
        "encode ssw07 248 start",
        code=2,
        err="ADDRESS 248 is out of range (1..247)",
    ),
    line_row(
        "an unknown verb is answered with those that exist",
        "encode sst 1 jog value=true",
        code=2,
        err=("no such verb: 'jog'", "configure"),
    ),
    line_row(
        "a missing argument is named", "encode ssw07 1 set parameter=P314", code=2, err="value is missing"
    ),
    line_row("so is one too many", "encode ssw07 1 start reason=x", code=2, err="reason is unknown"),
    line_row(
        "arguments are keys and values", "encode ssw07 1 set P314 30", code=2, err="'P314' is not KEY=VALUE"
    ),
    line_row(
        "what may not be written has no frame",
        "encode ssw07 1 set parameter=P003 value=5",
        code=1,
        out="",
        err="not_writable: ",
    ),
    line_row(
        "nor has a value outside the manual's range",
        "encode ssw07 1 set parameter=P314 value=1000",
        code=1,
        out="",
        err="P314 takes 0..999 s",
    ),
]


@pytest.mark.parametrize("row", DECODE)
def test_decode(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)


@pytest.mark.parametrize("row", ENCODE)
def test_encode(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)
