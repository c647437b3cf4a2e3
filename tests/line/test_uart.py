"""The UART's own error counters, by a driver that has them and by one that has not."""

from __future__ import annotations

import struct

from gateway.line.port.tty import uart_errors


def test_the_counters_are_taken_from_the_kernels_struct() -> None:
    asked = []

    def ioctl(fd: int, request: int, octets: bytes) -> bytes:
        asked.append((fd, request, len(octets)))
        return struct.pack("20i", 1, 2, 3, 4, 50, 60, 7, 8, 9, 10, 11, *[0] * 9)

    assert uart_errors(5, ioctl) == {
        "frame": 7,
        "overrun": 8,
        "parity": 9,
        "break": 10,
        "buffer_overrun": 11,
    }
    assert asked == [(5, 0x545D, 80)]
