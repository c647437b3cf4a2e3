from __future__ import annotations

import random

import pytest

from gateway.line.rtu.bus_faults import (
    ADDRESS_CONFLICT,
    BABBLING,
    LATE_OR_TWICE,
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


def test_a_unit_that_is_answered_for_by_two_is_named() -> None:
    line = Line()

    for _ in range(3):
        line.answer(7, 1)
        line.stray(reply(7, 2), asked=7)

    assert line.bus_faults.take_news() == (
        BusFault(
            ADDRESS_CONFLICT,
            7,
            "address 7 seems to be given twice: what is asked of it is answered more than once",
        ),
    )


def test_two_that_say_the_same_are_named_too_but_later() -> None:
    line = Line()

    for _ in range(3):
        line.answer(8)
        line.answer(7)
        line.stray(reply(7), asked=7)
    assert line.reported() == []
    for _ in range(2):
        line.answer(8)
        line.answer(7)
        line.stray(reply(7), asked=7)

    assert line.reported() == [(ADDRESS_CONFLICT, 7)]


def test_a_way_that_doubles_the_replies_of_all_is_no_conflict() -> None:
    line = Line()

    for value in range(20):
        for unit in (1, 2, 3):
            line.answer(unit, value)
            line.stray(reply(unit, value), asked=unit)

    assert line.bus_faults.take_news() == (BusFault(BABBLING, SOMEONE, LATE_OR_TWICE),)


def test_nor_is_one_that_doubles_those_of_the_only_starter() -> None:
    line = Line()

    for value in range(20):
        line.answer(1, value)
        line.stray(reply(1, value))

    assert line.reported() == [(BABBLING, SOMEONE)]


def test_a_copy_that_comes_after_the_next_reply_is_no_other_reply() -> None:
    line = Line()

    for value in range(20):
        line.answer(1, value)
        line.now_s -= 0.9
        line.answer(1, value + 1)
        line.stray(reply(1, value))

    assert line.reported() == [(BABBLING, SOMEONE)]


def test_late_replies_soon_after_others_of_their_unit_are_no_conflict() -> None:
    line = Line()

    for value in range(1, 20):
        line.owing.add(3)
        line.answer(3, value)
        line.stray(reply(3, value - 1), asked=3)
        line.answer(1)
        line.stray(reply(3, value), asked=1)

    assert line.reported() == [(BABBLING, SOMEONE)]


def test_replies_that_run_into_late_ones_are_no_conflict() -> None:
    line = Line()

    for value in range(20):
        line.owing.add(1)
        line.stray(reply(1, value))
        line.garbled(b"\xa5" * SIZE)
        line.answer(2)

    assert ADDRESS_CONFLICT not in {code for code, _ in line.reported()}


def test_a_reply_of_another_shape_answers_no_request_of_now() -> None:
    line = Line()

    for value in range(20):
        line.answer(3)
        line.stray(adu.encode(3, ReadHoldingRegisters(0, 2).encode_reply((value, value))), asked=3)

    assert line.reported() == [(BABBLING, SOMEONE)]


def test_a_second_reply_is_seen_while_another_unit_is_asked() -> None:
    line = Line()

    for _ in range(4):
        line.answer(7, 1)
        line.now_s -= 0.98
        line.garbled(reply(7, 2), unit=8)

    assert line.reported() == [(ADDRESS_CONFLICT, 7)]


@pytest.mark.parametrize("merged", [b"\xa5" * SIZE, reply(1)[:6] + reply(1, 3)])
def test_replies_that_merge_again_and_again_are_named(merged: bytes) -> None:
    line = Line()

    for _ in range(12):
        line.garbled(merged)

    assert line.reported() == [(ADDRESS_CONFLICT, 1)]


def test_the_torn_rest_of_a_second_reply_counts() -> None:
    line = Line()

    for _ in range(10):
        line.answer(1)
        line.stray(reply(1, 9)[:7])

    assert line.reported() == [(ADDRESS_CONFLICT, 1)]


def test_a_noisy_line_is_no_conflict() -> None:
    line = Line()

    for _ in range(100):
        for _ in range(9):
            line.answer(1)
        line.garbled(b"\xa5" * SIZE)
        line.garbled(reply(1)[:-3])

    assert set(line.reported()) == {(LINE_NOISE, SOMEONE)}


def test_noise_on_a_line_of_eight_is_named_and_accuses_no_address() -> None:
    line, dice = Line(), random.Random(3)

    for _ in range(2000):
        for unit in range(1, 9):
            if dice.random() < 0.2:
                line.garbled(b"\xa5" * SIZE, unit=unit)
            else:
                line.answer(unit)

    assert set(line.reported()) == {(LINE_NOISE, SOMEONE)}


def test_two_with_one_address_among_clean_ones_are_no_noise() -> None:
    line = Line()

    for _ in range(40):
        for unit in range(1, 8):
            line.answer(unit)
        line.garbled(b"\xa5" * SIZE, unit=8)

    assert set(line.reported()) == {(ADDRESS_CONFLICT, 8)}


def test_a_doubled_reply_now_and_then_is_none_either() -> None:
    line = Line()

    for _ in range(20):
        for _ in range(30):
            line.answer(1)
        line.stray(reply(1))

    assert line.reported() == []


def test_late_replies_are_named_as_such() -> None:
    line = Line()
    line.owing.add(3)

    for _ in range(20):
        line.answer(1)
        line.stray(reply(3))
        line.garbled(reply(3))

    assert line.bus_faults.take_news() == (BusFault(BABBLING, SOMEONE, LATE_OR_TWICE),)


def test_a_late_reply_now_and_then_is_not_reported() -> None:
    line = Line()
    line.owing.add(3)

    for _ in range(50):
        line.stray(reply(3), after_s=30.0)

    assert line.reported() == []


def test_a_unit_that_talks_unasked_is_named() -> None:
    line = Line()

    for _ in range(5):
        line.answer(1)
        line.stray(reply(9), after_s=RECENTLY_S + 1.0)

    assert line.bus_faults.take_news() == (BusFault(BABBLING, 9, "unit 9 talks without being asked"),)


def test_a_frame_now_and_then_without_a_request_is_not_reported() -> None:
    line = Line()

    for _ in range(50):
        line.stray(reply(9), after_s=60.0)

    assert line.reported() == []


def test_noise_that_goes_on_is_somebody_who_talks() -> None:
    line = Line()

    for _ in range(40):
        line.stray(NOISE, after_s=0.5)

    assert line.reported() == [(BABBLING, SOMEONE)]


def test_single_bytes_are_what_drivers_make() -> None:
    line = Line()

    for _ in range(200):
        line.stray(b"\x00", after_s=0.1)

    assert line.reported() == []


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
