"""A Modbus RTU client of the tests' own: its own CRC, its own frames, its own serial port.

It shares no code with the product, so that a mistake in the product's codec cannot hide in its simulators.
"""

from __future__ import annotations

import os
import select
import termios
import time
import tty

_RATES = {9600: termios.B9600, 19200: termios.B19200, 38400: termios.B38400}
_SILENCE_S = 0.004
_PATIENCE_S = 10.0  # until the first byte
_GAP_S = 0.05  # inside a reply


def crc(data: bytes) -> bytes:
    """Return the CRC as sent, by the bitwise method of the manuals' appendix B."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return bytes((value & 0xFF, value >> 8))


class ModbusExceptionError(Exception):
    """The unit answered with an exception."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"exception {code}")


class Client:
    """Talks to the units on one tty."""

    def __init__(self, path: str, *, baud: int, stop_bits: int) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._fd)
        attributes = termios.tcgetattr(self._fd)
        attributes[2] = attributes[2] & ~termios.CSTOPB | (termios.CSTOPB if stop_bits == 2 else 0)
        attributes[4] = attributes[5] = _RATES[baud]
        termios.tcsetattr(self._fd, termios.TCSANOW, attributes)

    def close(self) -> None:
        os.close(self._fd)

    def raw(self, frame: bytes, *, patience_s: float = _PATIENCE_S) -> bytes:
        """Send a frame as it is and return all bytes of the answer, b"" for none."""
        time.sleep(_SILENCE_S)
        os.write(self._fd, frame)
        answer = b""
        while select.select([self._fd], [], [], _GAP_S if answer else patience_s)[0]:
            answer += os.read(self._fd, 300)
        return answer

    def ask(self, unit: int, function: int, data: bytes) -> bytes:
        """Return the answer's data; ModbusExceptionError, TimeoutError, ValueError."""
        body = bytes((unit, function)) + data
        answer = self.raw(body + crc(body))
        if not answer:
            raise TimeoutError(f"unit {unit} is silent")
        if crc(answer[:-2]) != answer[-2:] or answer[0] != unit:
            raise ValueError(f"no answer of unit {unit}: {answer.hex(' ')}")
        if answer[1] == function | 0x80:
            raise ModbusExceptionError(answer[2])
        if answer[1] != function:
            raise ValueError(f"another function: {answer.hex(' ')}")
        return answer[2:-2]

    def registers(self, unit: int, address: int, count: int = 1, *, function: int = 3) -> list[int]:
        data = self.ask(unit, function, _two(address, count))
        if data[0] != 2 * count or len(data) != 1 + 2 * count:
            raise ValueError(f"wrong length: {data.hex(' ')}")
        return [data[1 + 2 * at] << 8 | data[2 + 2 * at] for at in range(count)]

    def coils(self, unit: int, address: int, count: int) -> list[bool]:
        return self.bits(unit, 1, address, count)

    def bits(self, unit: int, function: int, address: int, count: int) -> list[bool]:
        data = self.ask(unit, function, _two(address, count))
        if data[0] != (count + 7) // 8 or len(data) != 1 + data[0]:
            raise ValueError(f"wrong length: {data.hex(' ')}")
        return [bool(data[1 + at // 8] >> at % 8 & 1) for at in range(count)]

    def write_coil(self, unit: int, address: int, *, is_on: bool) -> None:
        data = _two(address, 0xFF00 if is_on else 0)
        if self.ask(unit, 5, data) != data:
            raise ValueError("no echo")

    def write(self, unit: int, address: int, word: int) -> None:
        data = _two(address, word)
        if self.ask(unit, 6, data) != data:
            raise ValueError("no echo")

    def write_several(self, unit: int, address: int, *words: int) -> None:
        values = b"".join(bytes((word >> 8, word & 0xFF)) for word in words)
        data = _two(address, len(words))
        if self.ask(unit, 16, data + bytes((len(values),)) + values) != data:
            raise ValueError("no echo")

    def identification(self, unit: int) -> dict[int, str]:
        """Return the objects of FC43/14, read code 1, from object 0."""
        data = self.ask(unit, 43, bytes((14, 1, 0)))
        objects, rest = {}, data[6:]
        while rest:
            objects[rest[0]] = rest[2 : 2 + rest[1]].decode("ascii")
            rest = rest[2 + rest[1] :]
        return objects


def _two(first: int, second: int) -> bytes:
    return bytes((first >> 8, first & 0xFF, second >> 8, second & 0xFF))
