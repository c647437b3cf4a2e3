"""How long characters, frames and silences take [SERIAL 2.5.1.1; ssw06-es, ssw07 5.2.5; ssw900 table 2.2]."""

from __future__ import annotations

import pytest

from gateway.modbus.timing import Framing, LineTiming


def timing(baud: int, framing: str = "8E1") -> LineTiming:
    return LineTiming(baud, Framing.parse(framing))


@pytest.mark.parametrize(
    ("text", "parity", "stop_bits", "character_bits"),
    [("8N1", "N", 1, 10), ("8E1", "E", 1, 11), ("8O1", "O", 1, 11), ("8N2", "N", 2, 11), ("8E2", "E", 2, 12)],
)
def test_a_framing_is_read_as_it_is_written(
    text: str, parity: str, stop_bits: int, character_bits: int
) -> None:
    framing = Framing.parse(text)

    assert (framing.parity, framing.stop_bits, framing.character_bits) == (parity, stop_bits, character_bits)
    assert str(framing) == text
    assert Framing.parse(text.lower()) == framing


@pytest.mark.parametrize("text", ["", "7E1", "8M1", "8E3", "8E", "8E1 ", "8-E-1"])
def test_a_framing_that_rtu_does_not_know_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="8N1, 8E1"):
        Framing.parse(text)


@pytest.mark.parametrize(
    ("baud", "silence_ms", "character_ms"),
    [
        (1200, 32.083, 9.167),
        (2400, 16.042, 4.583),
        (4800, 8.021, 2.292),
        (9600, 4.01, 1.146),
        (19200, 2.005, 0.573),
        (38400, 2.005, 0.286),
        (57600, 2.005, 0.191),
    ],
)
def test_the_silence_between_frames_is_the_one_of_the_manuals(
    baud: int, silence_ms: float, character_ms: float
) -> None:
    assert timing(baud).silence_s * 1000 == pytest.approx(silence_ms, abs=0.0006)
    assert timing(baud).character_s * 1000 == pytest.approx(character_ms, abs=0.0005)
