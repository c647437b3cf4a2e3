"""Time as the gateway sees it: a clock that never steps for intervals, and the wall's for time stamps."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol

ASK_EVERY_S = 10.0
FORBIDDEN = -1  # adjtimex(2): no answer
TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised
STA_UNSYNC = 0x0040  # the same in its status

# Touched by systemd-timesyncd(8) at each synchronisation, every 34 minutes at the latest by its default.
TIMESYNC_MARK = Path("/run/systemd/timesync/synchronized")
MARK_VALID_S = 2 * 3600.0

Trust = Literal["auto", "trusted", "untrusted"]


class Clock(Protocol):
    """What the loops need of time; tests give a virtual one."""

    def now_s(self) -> float:
        """Return seconds on a clock that never steps; only differences mean anything."""
        ...

    def utc_s(self, at_s: float | None = None) -> float:
        """Return the wall time (seconds since 1970, UTC) of now, or of `at_s` on the steady clock."""
        ...


class SystemClock:
    """The machine's own clocks; the steady one is also asyncio's (`loop.time()`)."""

    def now_s(self) -> float:
        """Return `time.monotonic()`."""
        return time.monotonic()

    def utc_s(self, at_s: float | None = None) -> float:
        """Return the wall time; a stamp of the past is carried over by its distance from now."""
        age_s = 0.0 if at_s is None else time.monotonic() - at_s
        return time.time() - age_s


class _Timex(ctypes.Structure):
    """The head of `struct timex`; the kernel writes what follows into `rest`, whatever its size here."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("frequency", ctypes.c_long),
        ("max_error", ctypes.c_long),
        ("estimated_error", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 512),
    )


def is_kernel_clock_synchronised() -> bool:
    """Return whether a time service keeps the system clock; False when nobody says so.

    A service's sandbox (ProtectClock) forbids the question; there timesyncd's mark must do.
    """
    timex = _Timex()  # modes = 0: only asks
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.byref(timex))
    except (OSError, AttributeError):
        state = FORBIDDEN
    if state == FORBIDDEN:
        return is_marked(TIMESYNC_MARK, utc_s=time.time())
    return is_synchronised_state(state, timex.status)


def is_marked(mark: Path, *, utc_s: float) -> bool:
    """Return whether timesyncd has marked a synchronisation not long ago."""
    try:
        age_s = utc_s - mark.stat().st_mtime
    except OSError:
        return False
    return 0 <= age_s <= MARK_VALID_S


def is_synchronised_state(state: int, status: int) -> bool:
    """Return what adjtimex said: its return value and the status beside it."""
    return 0 <= state != TIME_ERROR and not status & STA_UNSYNC


class ClockWatch:
    """Whether time stamps from elsewhere can be compared with the system clock."""

    def __init__(
        self,
        trust: Trust = "auto",
        *,
        ask: Callable[[], bool] = is_kernel_clock_synchronised,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._trust = trust
        self._ask = ask
        self._now_s = now_s
        self._answer = False
        self._asked_s: float | None = None

    def trust(self, trust: Trust) -> None:
        """Go by another configuration from now on."""
        self._trust = trust

    def is_synchronised(self) -> bool:
        """Return what the configuration says, else what the kernel said at most 10 s ago."""
        if self._trust != "auto":
            return self._trust == "trusted"
        now_s = self._now_s()
        if self._asked_s is None or now_s - self._asked_s >= ASK_EVERY_S:
            self._answer = self._ask()
            self._asked_s = now_s
        return self._answer
