"""What the UART itself has counted: it tells a bad line from a mute starter. Not every driver counts."""

from __future__ import annotations

import fcntl
import struct
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

_TIOCGICOUNT = 0x545D  # [linux/asm-generic/ioctls.h]
_ICOUNTER = struct.Struct("20i")  # struct serial_icounter_struct [linux/serial.h]: 11 counters, 9 reserved
_PLACES = {"frame": 6, "overrun": 7, "parity": 8, "break": 9, "buffer_overrun": 10}


@runtime_checkable
class CountsErrors(Protocol):
    """An opener that may know what the UART of its open port has counted."""

    def uart_errors(self) -> dict[str, int] | None:
        """Return the counters since the driver began; None where there are none."""
        ...


def uart_errors(fd: int, ioctl: Callable[..., Any] = fcntl.ioctl) -> dict[str, int] | None:
    """Return the error counters of a tty; None where its driver has none, or the tty is gone."""
    try:
        answer = ioctl(fd, _TIOCGICOUNT, bytes(_ICOUNTER.size))
    except OSError:
        return None
    counters = _ICOUNTER.unpack(answer)
    return {name: counters[place] for name, place in _PLACES.items()}
