from __future__ import annotations

import pytest

from gateway.cli.main import main
from gateway.modbus import adu


def encode(capsys: pytest.CaptureFixture[str], *words: str) -> list[str]:
    assert main(["encode", *words]) == 0
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize(
    ("words", "frames"),
    [
        ("ssw07 1 start", ["01 05 00 64 FF 00 CD E5"]),
        ("ssw07 1 stop", ["01 05 00 64 00 00 8C 15"]),
        (
            "ssw07 1 reset",  # run = 0 and jog = 0, then the edge (ssw07 4.2.2, 5.4.3)
            [
                "01 05 00 64 00 00 8C 15",
                "01 05 00 66 00 00 2D D5",
                "01 05 00 6B 00 00 BC 16",
                "01 05 00 6B FF 00 FD E6",
            ],
        ),
        ("ssw06 3 start", ["03 06 13 8B 01 01 3C D6"]),
        ("ssw06 3 stop", ["03 06 13 8B 01 00 FD 16"]),
        (
            "ssw06 3 reset",  # ssw06-es 4.2.3
            [
                "03 06 13 8B 01 00 FD 16",
                "03 06 13 8B 04 00 FE 46",
                "03 06 13 8B 80 00 9D 46",
                "03 06 13 8B 80 80 9C E6",
            ],
        ),
        ("ssw900 5 start --slot 1 --last-word 0x12", ["05 06 02 AD 00 13 59 DA"]),
        ("ssw900 5 start --slot 2 --last-word 18", ["05 06 02 AE 00 13 A9 DA"]),
        ("ssw900 1 stop --slot 1", ["01 16 02 AD FF FA 00 00 4A 19"]),  # the word is not known
        ("ssw900 4 stop", ["04 16 02 AD FF FA 00 00 8A 26", "04 16 02 AE FF FA 00 00 CE 26"]),  # nor the slot
        ("ssw900 1 stop --slot 2 --last-word 0x13", ["01 06 02 AE 00 12 69 9E"]),
        ("ssw07 1 set parameter=P314 value=30", ["01 06 01 3A 00 1E 28 33"]),
        ("ssw06 1 set parameter=VB09 value=50", ["01 06 13 91 1F FF 94 D3"]),  # per cent (ssw06-es 4.2.8)
        ("ssw06 1 set parameter=VB10 value=50", ["01 06 13 92 1F FF 64 D3"]),
        ("ssw06 1 set parameter=VB10 value=12.5", ["01 06 13 92 07 FF 6E D3"]),
        ("ssw06 1 output output=AO1 value=50", ["01 06 13 91 1F FF 94 D3"]),  # VB09 drives it
        ("ssw07 1 set parameter=p314 value=0x1E", ["01 06 01 3A 00 1E 28 33"]),
        ("ssw07 1 read parameter=P003", ["01 03 00 03 00 01 74 0A"]),
        ("sst 9 start", ["09 05 00 00 FF 00 8D 72"]),
        (
            "sst 9 set parameter=R41 value=10",  # all of the configuration mode
            [
                "09 05 00 00 00 00 CC 82",
                "09 05 00 01 FF 00 DC B2",
                "09 06 00 29 00 0A D9 4D",
                "09 05 00 01 00 00 9D 42",
            ],
        ),
        (
            "sst 9 configure R41=10",
            [
                "09 05 00 00 00 00 CC 82",
                "09 05 00 01 FF 00 DC B2",
                "09 06 00 29 00 0A D9 4D",
                "09 05 00 01 00 00 9D 42",
            ],
        ),
    ],
)
def test_a_commands_writes_are_printed_in_order(
    words: str, frames: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    shown = encode(capsys, *words.split())

    assert shown == frames
    assert all(adu.decode(bytes.fromhex(frame)) for frame in shown)  # the CRC is right


@pytest.mark.parametrize(
    ("words", "code", "reported"),
    [
        ("ssw07 1 fly", 2, "this family has no such verb: 'fly'"),
        ("ssw07 0 start", 2, "ADDRESS 0 is out of range (1..247)"),
        ("ssw07 one start", 2, "ADDRESS 'one' is no number"),
        ("ssw07 1 set P314", 2, "argument 'P314' is not KEY=VALUE"),
        ("ssw07 1 set parameter=P314", 2, "value is missing"),
        ("ssw07 1 set parameter=P314 value=1 value=2", 2, "argument value stands twice"),
        ("ssw07 1 set parameter=Q1 value=1", 2, "the manual of this family names no such parameter"),
        ("ssw07 1 set parameter=P002 value=1", 1, "not_writable"),
        ("ssw07 1 set parameter=P314 value=1000", 1, "out_of_range"),
        ("ssw07 1 set parameter=P314 value=nan", 1, "bad_value"),
        ("ssw07 1 start --slot 1", 2, "ssw07 has no slots"),
        ("sst 1 start --last-word 1", 2, "sst has no command word"),
        ("ssw900 1 start", 2, "(give --slot 1 or --slot 2)"),
        ("ssw900 1 start --slot 1", 2, "(give --last-word)"),
        ("ssw900 1 start --slot 1 --last-word 65536", 2, "--last-word 65536 is out of range"),
    ],
)
def test_what_cannot_be_encoded_is_reported_in_one_line(
    words: str, code: int, reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["encode", *words.split()]) == code

    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert reported in captured.err
