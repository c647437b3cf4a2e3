"""`decode` and `encode`, against the telegrams and tables of the manuals."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.modbus import adu
from tests.rig import run_cli
from tests.scenarios.cli.lines import LineRow, Says, line_row, play_line

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
        "nor does the command's coil, and the command's bit",  # SSW-07 4.2.2
        "decode ssw07 coil 102 1 --firmware 1.30",
        json={"VB03.2/value": None, "VB03.2/label": None},
    ),
    line_row(
        "the rest of a command word means what it did",
        "decode ssw07 holding VB03 0x0007 --firmware 1.30",
        json={"VB03/bits/1/value": True, "VB03/bits/2/value": None, "VB03/bits/3/value": None},
    ),
    line_row(
        "an SST130i has its capacitor's voltage and its name from 2.00 on",  # SW version changes
        "decode sst input R20 5 0 0x5353 0x5431 0x3330 0x692D 0 0 0 0 --model SST130i --firmware 1.14",
        json={"R20/value": None, "R20/raw": [5], "R22/value": None, "R22-R29/value": None},
    ),
    line_row(
        "and an SST330i its name from 4.04 on",
        "decode sst input R22 0x5353 0x5433 0x3330 0x692D 0x4D00 0 0 0 --model SST330i --firmware 4.02",
        json={"R22-R29/value": None},
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
        "the name of an SST lies over eight registers, in either byte order",
        "decode sst input R22 0x5353 0x5433 0x3330 0x692D 0x4D2D 0x4553 0 0",
        json={"R22-R29/point": "name", "R22-R29/value": "SST330i-M-ES"},
    ),
    line_row(
        "so it is with the bytes of each word exchanged",
        "decode sst input R22 0x5353 0x3354 0x3033 0x2D69 0x2D4D 0x5345 0 0",
        json={"R22-R29/value": "SST330i-M-ES"},
    ),
    line_row(
        "version and serial number of an SST are joined",
        "decode sst input R2 0x0204 1 0 0 0 0 7 0xA120 0 0",
        json={"R2-R3/value": "4.21", "R8-R11/value": "500000"},
    ),
    line_row(
        "the analog outputs of an SSW-06 are in per cent",
        "decode ssw06 holding VB09 8191 4095",
        json={"VB09/value": 50.0, "VB09/unit": "%", "VB10/value": 25.0},
    ),
    line_row(
        "words that no manual names stand raw",
        "decode ssw900 holding 24 2186",  # half of two
        json={"HR24/value": 2186, "HR24/point": None},
    ),
]

# Words, and the frames without their address and CRC, which are checked by themselves. Run = 0 and jog = 0
# come before whatever could let an old command act.
FRAMES = """
ssw07 20 start                          | 05 00 64 FF 00
ssw07 1 stop                            | 05 00 64 00 00
ssw07 1 reset                           | 05 00 64 00 00, 05 00 66 00 00, 05 00 6B 00 00, 05 00 6B FF 00
ssw07 1 jog value=true                  | 05 00 66 FF 00
ssw07 1 general_enable value=false      | 05 00 65 00 00
ssw07 1 direction value=forward | {STOP}, 05 00 67 00 00
ssw07 1 local_remote value=remote | {STOP}, 05 00 68 FF 00, {STOP}
ssw07 15 set parameter=P314 value=5     | 06 01 3A 00 05
ssw07 1 set parameter=p314 value=0x1E   | 06 01 3A 00 1E
ssw07 1 read parameter=P003             | 03 00 03 00 01
ssw06 3 start                           | 06 13 8B 01 01
ssw06 3 stop                            | 06 13 8B 01 00
ssw06 3 reset                           | 06 13 8B 01 00, 06 13 8B 04 00, 06 13 8B 80 00, 06 13 8B 80 80
ssw06 1 direction value=reverse         | 06 13 8B 01 00, 06 13 8B 04 00, 06 13 8B 08 08
ssw06 1 set parameter=VB09 value=50     | 06 13 91 1F FF
ssw06 1 set parameter=VB10 value=12.5   | 06 13 92 07 FF
ssw06 1 output output=AO1 value=50      | 06 13 91 1F FF
ssw900 5 start --slot 1 --last-word 18  | 06 02 AD 00 13
ssw900 5 start --slot 2 --last-word 0x12 | 06 02 AE 00 13
ssw900 1 stop --slot 2                  | 16 02 AE FF FA 00 00
ssw900 4 stop                           | 16 02 AD FF FA 00 00, 16 02 AE FF FA 00 00
ssw900 1 stop --slot 2 --last-word 0x13 | 06 02 AE 00 12
ssw900 5 set --slot 1 parameter=C8.2.5.3 value=5 | 06 02 DE 00 32
sst 9 start                             | 05 00 00 FF 00
sst 4 stop                              | 05 00 00 00 00
sst 4 reset                             | 05 00 00 00 00, 05 00 02 FF 00
sst 4 read parameter=R13                | 04 00 0D 00 01
sst 4 read parameter=COIL5              | 01 00 04 00 01
sst 9 configure                         | 05 00 00 00 00, 05 00 01 FF 00, 05 00 01 00 00
sst 9 configure R41=10                  | 05 00 00 00 00, 05 00 01 FF 00, 06 00 29 00 0A, 05 00 01 00 00
sst 9 set parameter=R41 value=10        | 05 00 00 00 00, 05 00 01 FF 00, 06 00 29 00 0A, 05 00 01 00 00
"""
WRONG = """
decode sst holding R19 2                | 2 | R19 is in the table input, not holding
decode ssw07 input P003 1               | 2 | P003 is in the table holding, not input
decode ssw07 discrete 0 1               | 2 | no table 'discrete' (holding, input or coil)
decode ssw07 holding x 1                | 2 | START 'x' is no number
decode ssw07 holding 65536 1            | 2 | START 65536 is out of range (0..65535)
decode ssw07 holding 0 65536            | 2 | WORD 65536 is out of range (0..65535)
decode ssw07 coil 0 2                   | 2 | WORD 2 is out of range (0..1)
decode ssw07 holding 65535 1 2          | 2 | the last address is 65535
decode ssw99 holding 3 1                | 2 | no family 'ssw99'; there are sst, ssw06, ssw07, ssw900
decode ssw07 holding P99999 1           | 2 | WEG SSW-07/SSW-08 has no 'P99999'
encode ssw07 1 fly | 2 | this family has no verb 'fly'; there are start, stop, reset
encode sst 1 jog value=true             | 2 | this family has no verb 'jog'
encode ssw07 0 start                    | 2 | ADDRESS 0 is out of range (1..247)
encode ssw07 one start                  | 2 | ADDRESS 'one' is no number
encode ssw07 1 set P314 30              | 2 | argument 'P314' is not KEY=VALUE
encode ssw07 1 set parameter=P314       | 2 | value is missing
encode ssw07 1 start reason=x           | 2 | reason is unknown
encode ssw07 1 direction value=1        | 2 | value must be one of reverse, forward
encode ssw07 1 set parameter=P314 value=1 value=2 | 2 | argument value stands twice
encode ssw07 1 set parameter=Q1 value=1 | 2 | the manual of this family names no parameter Q1
encode ssw07 1 set parameter=P003 value=5 | 1 | not_writable
encode ssw07 1 set parameter=P314 value=1000 | 1 | P314 takes 0..999 s
encode ssw07 1 set parameter=P314 value=nan | 1 | bad_value
encode ssw07 1 set parameter=P314 value=1.5 | 1 | P314 takes at most 0 decimals
encode ssw07 1 start --slot 1           | 2 | ssw07 has no slots
encode sst 1 start --last-word 1        | 2 | sst has no command word
encode ssw900 1 start                   | 2 | (give --slot 1 or --slot 2)
encode ssw900 1 start --slot 1          | 2 | (give --last-word)
encode ssw900 1 start --slot 1 --last-word 65536 | 2 | --last-word 65536 is out of range
"""


@pytest.mark.parametrize("row", DECODE)
def test_decode(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)


@pytest.mark.parametrize(
    "line", FRAMES.replace("{STOP}", "05 00 64 00 00, 05 00 66 00 00").strip().splitlines()
)
def test_encode(line: str) -> None:
    words, frames = (part.strip() for part in line.split("|"))

    ran = run_cli("encode", *words.split())

    shown = [adu.decode(bytes.fromhex(frame)) for frame in ran.out.splitlines()]
    assert [frame.pdu.hex(" ").upper() for frame in shown] == frames.split(", ")
    assert {frame.unit for frame in shown} == {int(words.split()[1])}
    assert (ran.code, ran.err) == (0, "")


def test_the_manuals_reset_is_printed_as_the_manual_prints_it() -> None:  # SSW-07 5.4.3
    assert run_cli("encode", "ssw07", "1", "reset").out.endswith("\n01 05 00 6B FF 00 FD E6\n")


@pytest.mark.parametrize("line", WRONG.strip().splitlines())
def test_what_cannot_be_done_is_said_in_one_line(line: str) -> None:
    words, code, said = (part.strip() for part in line.split(" | "))

    assert not Says(words, code=int(code), out="", err=said).wrong(run_cli(*words.split()))
