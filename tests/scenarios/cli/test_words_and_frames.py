"""`decode` and `encode`, against the telegrams and tables of the manuals."""

from __future__ import annotations

import json
import re
import shlex

import pytest

from gateway.modbus import adu
from tests.rig import run_cli
from tests.scenarios.cli.lines import Says

# Words, and fields of the printed JSON by their paths. SSW-07 4.2.1, 4.2.2, 5.4.1, 5.4.2; SSW-06 5.4.2 and
# 4.4: a current of 820 A and more has no decimal; SSW900: the low word comes first; SST: SW version changes.
# A bit, a coil or a register that the firmware does not have means nothing.
DECODE = """
ssw07 holding 2 500 400 | P002/value 50.0, P002/unit "%", P002/point "current_pct", P003/value 40.0, P003/raw [400]
ssw07 holding P002 0x01F4 0x0190 | P002/value 50.0, P003/value 40.0, P003/unit "A"
ssw06 holding P003 815 --model 'SSW-06 820A' | P003/value 815.0
ssw07 coil 0 0 1 | VB01.0/value false, VB01.0/label "motor stopped", VB01.1/value true, VB01.1/point "general_enabled"
ssw06 holding 5001 0x0103 | VB01/raw [259], VB01/bits/0/point "running", VB01/bits/0/value true, VB01/bits/2/value false
ssw07 holding 5001 4 --firmware 1.30 | VB01/bits/2/point "jog", VB01/bits/2/value null, VB01/bits/2/meaning null
ssw07 coil 2 1 --firmware 1.30 | VB01.2/point "jog", VB01.2/value null, VB01.2/label null
ssw07 coil 102 1 --firmware 1.30 | VB03.2/value null, VB03.2/label null
ssw07 holding VB03 7 --firmware 1.30 | VB03/bits/1/value true, VB03/bits/2/value null, VB03/bits/3/value null
ssw07 coil 2 1 --firmware 1.40 | VB01.2/value true, VB01.2/label "with jog"
ssw07 holding P014 5 | P014/label "E05 Motor overload", P014/point "fault_code"
ssw900 holding 24 23 0 | S1.1.4/value 2.3, S1.1.4/unit "A", S1.1.4/raw [23, 0]
ssw900 holding 24 2186 | HR24/value 2186, HR24/point null
sst input R20 5 0 0x5353 0x5431 0 0 0 0 0 0 --model SST130i --firmware 1.14 | R20/value null, R20/raw [5], R22/value null, R22-R29/value null
sst input R22 0x5353 0x5433 0x3330 0x692D 0x4D00 0 0 0 --model SST330i --firmware 4.02 | R22-R29/value null
sst input R22 0x5353 0x5433 0x3330 0x692D 0x4D2D 0x4553 0 0 | R22-R29/point "name", R22-R29/value "SST330i-M-ES"
sst input R2 0x0204 1 0 0 0 0 7 0xA120 0 0 | R2-R3/value "4.21", R8-R11/value "500000"
"""  # noqa: E501 - a line each

# Words, and the frames without address and CRC, which are checked by themselves. All frames of all verbs:
# tests/families/test_commands.py.
FRAMES = """
ssw07 20 start                          | 05 00 64 FF 00
ssw07 1 reset                           | 05 00 64 00 00, 05 00 66 00 00, 05 00 6B 00 00, 05 00 6B FF 00
ssw07 1 jog value=true                  | 05 00 66 FF 00
ssw07 1 local_remote value=remote | {STOP}, 05 00 68 FF 00, {STOP}
ssw07 15 set parameter=p314 value=0x1E  | 06 01 3A 00 1E
ssw07 1 read parameter=P003             | 03 00 03 00 01
ssw06 1 set parameter=VB10 value=12.5   | 06 13 92 07 FF
ssw06 1 output output=AO1 value=50      | 06 13 91 1F FF
ssw900 5 start --slot 2 --last-word 0x12 | 06 02 AE 00 13
ssw900 1 stop --slot 2                  | 16 02 AE FF FA 00 00
ssw900 4 stop                           | 16 02 AD FF FA 00 00, 16 02 AE FF FA 00 00
sst 4 read parameter=COIL5              | 01 00 04 00 01
sst 9 configure R41=10                  | 05 00 00 00 00, 05 00 01 FF 00, 06 00 29 00 0A, 05 00 01 00 00
"""
WRONG = """
decode sst holding R19 2                | 2 | R19 is in the table input, not holding
decode ssw07 input P003 1               | 2 | P003 is in the table holding, not input
decode ssw07 discrete 0 1               | 2 | argument TABLE: invalid choice: 'discrete'
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
encode ssw07 1 set parameter=P314 value=1 value=2 | 2 | argument value is given twice
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


@pytest.mark.parametrize("line", DECODE.strip().splitlines())
def test_decode(line: str) -> None:
    words, fields = line.split(" | ")
    pairs = (each.split(" ", 1) for each in re.split(r", (?=\w+[\w.-]*/)", fields))
    wanted = {path: json.loads(value) for path, value in pairs}

    assert not Says(words, json=wanted).wrong(run_cli("decode", *shlex.split(words)))


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
