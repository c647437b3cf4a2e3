from __future__ import annotations

import pytest

from gateway.modbus.timing import BROADCAST_TURNAROUND_S, Framing, LineTiming


def timing(baud: int, framing: str = "8E1") -> LineTiming:
    return LineTiming(baud, Framing.parse(framing))


@pytest.mark.parametrize(
    ("text", "parity", "stop_bits", "character_bits"),
    [
        ("8N1", "N", 1, 10),
        ("8E1", "E", 1, 11),
        ("8O1", "O", 1, 11),
        ("8N2", "N", 2, 11),
        ("8E2", "E", 2, 12),
        ("8O2", "O", 2, 12),
    ],
)
def test_a_framing_is_read_as_it_is_written(
    text: str, parity: str, stop_bits: int, character_bits: int
) -> None:
    framing = Framing.parse(text)

    assert (framing.parity, framing.stop_bits, framing.character_bits) == (parity, stop_bits, character_bits)
    assert str(framing) == text


def test_a_framing_in_small_letters_is_the_same() -> None:
    assert Framing.parse("8e1") == Framing.parse("8E1")


@pytest.mark.parametrize("text", ["", "7E1", "8M1", "8E3", "8E", "8E1 ", "8-E-1"])
def test_a_framing_that_rtu_does_not_know_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="8N1, 8E1"):
        Framing.parse(text)


@pytest.mark.parametrize("baud", [0, -9600])
def test_a_line_without_speed_is_refused(baud: int) -> None:
    with pytest.raises(ValueError, match="no speed"):
        timing(baud)


@pytest.mark.parametrize(
    ("baud", "silence_ms"),
    [  # ssw06-es 5.2.5, ssw07 5.2.5, ssw900 table 2.2
        (1200, 32.083),
        (2400, 16.042),
        (4800, 8.021),
        (9600, 4.01),
        (19200, 2.005),
        (38400, 2.005),
        (57600, 2.005),
    ],
)
def test_the_silence_between_frames_is_the_one_of_the_manuals(baud: int, silence_ms: float) -> None:
    assert timing(baud).silence_s * 1000 == pytest.approx(silence_ms, abs=0.0006)


@pytest.mark.parametrize(
    ("baud", "character_ms"), [(1200, 9.167), (4800, 2.292), (9600, 1.146), (19200, 0.573)]
)
def test_a_character_of_eleven_bits_takes_the_time_of_the_manuals(baud: int, character_ms: float) -> None:
    assert timing(baud).character_s * 1000 == pytest.approx(character_ms, abs=0.0005)


def test_a_short_character_is_still_counted_with_eleven_bits_in_silences() -> None:
    assert timing(9600, "8N1").silence_s == timing(9600, "8E1").silence_s


def test_a_long_character_makes_the_silence_longer() -> None:
    assert timing(9600, "8E2").silence_s == pytest.approx(3.5 * 12 / 9600)


def test_no_speed_makes_the_silence_shorter_than_the_specification_wants() -> None:
    assert timing(115200, "8N1").silence_s > 0.00175  # [SERIAL 2.5.1.1]


def test_a_frame_takes_the_wire_for_the_time_of_its_characters() -> None:
    assert timing(19200, "8N1").wire_s(8) == pytest.approx(80 / 19200)
    assert timing(57600, "8E2").wire_s(256) == pytest.approx(256 * 12 / 57600)


def test_units_are_given_the_longer_time_after_a_broadcast() -> None:
    assert BROADCAST_TURNAROUND_S == 0.2  # [SERIAL 2.4.1]: 100..200 ms
