"""A tap between the simulated starters' pty and the one that the gateway opens: it notes every request."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import serial

from gateway.errors import BadFrameError
from gateway.modbus.adu import crc16
from tests.modbus.request_size import request_adu_size

WRITES = {5, 6, 15, 16, 22, 23}  # function codes that change something in a starter


@dataclass(frozen=True)
class TappedRequest:
    """A frame of the gateway."""

    at_s: float  # of the monotonic clock
    address: int
    function: int


class LineTap:
    """`path` is what the gateway opens; the requests are `requests`."""

    def __init__(self, simulator: str, *, baud: int) -> None:
        self._theirs = serial.Serial(simulator, baud, stopbits=2, timeout=0)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        Path(self.path).chmod(0o666)
        self.requests: list[TappedRequest] = []
        self.unknown: list[bytes] = []
        self._begun = b""  # of a request whose end has not been read yet
        self._is_over = False
        self._copier = threading.Thread(target=self._copy, daemon=True)

    def __enter__(self) -> LineTap:
        self._copier.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._copier.join(10.0)
        self._theirs.close()
        os.close(self._master)
        os.close(self._slave)

    def writes_since(self, at_s: float) -> list[TappedRequest]:
        """Return the requests since a time that change something in a starter."""
        return [each for each in self.requests if each.at_s >= at_s and each.function in WRITES]

    def longest_gap_s(self, address: int, since_s: float) -> float:
        """Return the longest time without a request to a starter, from a time until now."""
        times = [each.at_s for each in self.requests if each.address == address and each.at_s >= since_s]
        edges = [since_s, *times, time.monotonic()]
        return max(later - earlier for earlier, later in pairwise(edges))

    def _copy(self) -> None:
        theirs = self._theirs.fileno()
        other = {theirs: self._master, self._master: theirs}
        while not self._is_over:
            for source in select.select(tuple(other), (), (), 0.2)[0]:
                octets = os.read(source, 4096)
                if source == self._master:
                    self._note(octets)
                os.write(other[source], octets)

    def _note(self, octets: bytes) -> None:
        """Note the requests; one read may bring two of them or a part of one."""
        self._begun += octets
        try:
            while (size := request_adu_size(self._begun)) is not None and size <= len(self._begun):
                frame, self._begun = self._begun[:size], self._begun[size:]
                if crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little"):
                    self.requests.append(TappedRequest(time.monotonic(), frame[0], frame[1]))
                else:
                    self.unknown.append(frame)
        except BadFrameError:
            self.unknown.append(self._begun)
            self._begun = b""
