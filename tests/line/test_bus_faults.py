from __future__ import annotations

import random

import pytest

from gateway.line.rtu.bus_faults import (
    ADDRESS_CONFLICT,
    BABBLING,
    LINE_NOISE,
    RECENTLY_S,
    REPORTED_AGAIN_AFTER_S,
    SOMEONE,
    BusFault,
    BusFaults,
)
from gateway.modbus import adu
from gateway.modbus.reads import ReadHoldingRegisters

READ = ReadHoldingRegisters(0, 4)
SIZE = 13
NOISE = b"\xa5\x5a\xa5\x5a\x00\x11"


def reply(unit: int, value: int = 0) -> bytes:
    return adu.encode(unit, READ.encode_reply((value,) * 4))


class Line:
    """Signs, one second apart unless said otherwise."""

    def __init__(self) -> None:
        self.bus_faults = BusFaults()
        self.owing: set[int] = set()
        self.now_s = 0.0

    def answer(self, unit: int, value: int = 0) -> None:
        self.now_s += 1.0
        self.bus_faults.note_asked(unit)
        self.bus_faults.note_answer(unit, reply(unit, value), at_s=self.now_s)

    def stray(self, data: bytes, *, asked: int = 1, after_s: float = 0.02) -> None:
        self.now_s += after_s
        self.bus_faults.note_stray(data, asked=asked, owes=self.owing.__contains__, now_s=self.now_s)

    def garbled(self, data: bytes, unit: int = 1) -> None:
        self.now_s += 1.0
        self.bus_faults.note_asked(unit)
        self.bus_faults.note_garbled(
            unit, data, reply_size=SIZE, owes=self.owing.__contains__, now_s=self.now_s
        )

    def reported(self) -> list[tuple[str, int]]:
        return [(fault.code, fault.unit) for fault in self.bus_faults.take_news()]

    def do(self, sign: str, number: int) -> None:
        """Do one sign: `s7=2@1+5` is unit 7 that says 2 while 1 is asked, 5 s later; see `SIGNS`."""
        if sign.startswith("-"):
            self.now_s -= float(sign[1:])
            return
        kind, rest = sign[0], sign[1:]
        rest, _, after = rest.partition("+")
        rest, _, asked = rest.partition("@")
        unit, _, value = rest.partition("=")
        said = reply(
            int(unit or 1), number if value == "n" else number - 1 if value == "p" else int(value or 0)
        )
        after_s, asked_of = float(after or 0.02), int(asked or unit or 1)
        match kind:
            case "a":
                self.answer(int(unit), said[4])
            case "s":
                self.stray(said, asked=asked_of, after_s=after_s)
            case "t":
                self.stray(said[:7], asked=asked_of)
            case "f":
                self.stray(
                    adu.encode(int(unit), ReadHoldingRegisters(0, 2).encode_reply((number, number))),
                    asked=asked_of,
                )
            case "g":
                self.garbled(said, unit=asked_of)
            case "b":
                self.garbled(b"\xa5" * SIZE, unit=asked_of)
            case "c":
                self.garbled(said[:-3], unit=asked_of)
            case "n":
                self.stray(NOISE if unit else b"\x00", after_s=after_s)
            case _:
                self.owing.add(int(unit))


CONFLICT, LATE, NOISY = ADDRESS_CONFLICT, BABBLING, LINE_NOISE

# a: an answer; s: a reply unasked, t: its beginning, f: of another shape; g: a reply garbles another,
# b: bytes do; c: a reply is cut; n1, n: noise, one byte; o: a reply is owed; -: so much sooner.
# =n: the number of the round, =p: of the one before it.
SIGNS = {  # so many rounds of these: who is named
    "one address, two answers": (3, "a7=1 s7=2", {(CONFLICT, 7)}),
    "two that say the same are not named at once": (3, "a8 a7 s7", set()),
    "but later": (5, "a8 a7 s7", {(CONFLICT, 7)}),
    "a way that doubles all": (20, "a1=n s1=n a2=n s2=n a3=n s3=n", {(LATE, SOMEONE)}),
    "or those of the only starter": (20, "a1=n s1=n", {(LATE, SOMEONE)}),
    "a copy after the next reply": (20, "a1=p -0.9 a1=n s1=p", {(LATE, SOMEONE)}),
    "late replies soon after others of their unit": (19, "o3 a3=n s3=p a1 s3=n@1", {(LATE, SOMEONE)}),
    "a reply of another shape": (20, "a3 f3", {(LATE, SOMEONE)}),
    "a second reply while another unit is asked": (4, "a7=1 -0.98 g7=2@8", {(CONFLICT, 7)}),
    "replies that merge again and again": (12, "b1", {(CONFLICT, 1)}),
    "the torn rest of a second reply": (10, "a1 t1=9", {(CONFLICT, 1)}),
    "a noisy line": (100, "a1 " * 9 + "b1 c1", {(NOISY, SOMEONE)}),
    "two with one address among clean ones": (40, "a1 a2 a3 a4 a5 a6 a7 b8", {(CONFLICT, 8)}),
    "a doubled reply now and then": (20, "a1 " * 30 + "s1", set()),
    "late replies": (20, "o3 a1 s3@1 g3@1", {(LATE, SOMEONE)}),
    "a late reply now and then": (50, "o3 s3@1+30", set()),
    "a unit that talks unasked": (5, f"a1 s9@1+{RECENTLY_S + 1}", {(BABBLING, 9)}),
    "a frame now and then": (50, "s9@1+60", set()),
    "noise that goes on": (40, "n1+0.5", {(BABBLING, SOMEONE)}),
    "single bytes, as drivers make": (200, "n+0.1", set()),
}


@pytest.mark.parametrize("name", SIGNS)
def test_who_is_named(name: str) -> None:
    rounds, signs, expected = SIGNS[name]
    line = Line()

    for number in range(1, 1 + rounds):
        for sign in signs.split():
            line.do(sign, number)

    assert set(line.reported()) == expected


def test_replies_that_run_into_late_ones_are_no_conflict() -> None:
    line = Line()

    for number in range(20):
        for sign in ["o1", "s1=n", "b1", "a2"]:
            line.do(sign, number)

    assert ADDRESS_CONFLICT not in {code for code, _ in line.reported()}


def test_noise_on_a_line_of_eight_is_named_and_accuses_no_address() -> None:
    line, dice = Line(), random.Random(3)

    for _ in range(2000):
        for unit in range(1, 9):
            line.do(f"{'b' if dice.random() < 0.2 else 'a'}{unit}", 0)

    assert set(line.reported()) == {(LINE_NOISE, SOMEONE)}


@pytest.mark.parametrize(
    ("stream", "unit", "text"),
    [
        (b"\x00\xff" + reply(5) + reply(5)[:4], 5, "unit 5 talks without being asked"),
        (b"\x55" * 256, SOMEONE, "someone on the line talks without being asked"),
    ],
)
def test_a_line_that_is_never_quiet_names_who_can_be_made_out(stream: bytes, unit: int, text: str) -> None:
    bus_faults = BusFaults()

    bus_faults.note_never_quiet(stream, now_s=1.0)

    assert bus_faults.take_news() == (BusFault(BABBLING, unit, text),)
    assert bus_faults.take_news() == ()


def test_a_trouble_that_lasts_is_reported_again_only_after_a_while() -> None:
    bus_faults = BusFaults()
    times_s = []

    for second in range(0, int(2.5 * REPORTED_AGAIN_AFTER_S), 10):
        bus_faults.note_never_quiet(b"", now_s=float(second))
        times_s += [second for _ in bus_faults.take_news()]

    assert times_s == [0, REPORTED_AGAIN_AFTER_S, 2 * REPORTED_AGAIN_AFTER_S]
