"""Time as the gateway sees it: a clock that never steps for intervals, and the wall's for time stamps.

The kernel moves the wall clock and the clock since boot alike, also when a time service slews them; only a
step, by a person or a service, changes their difference. After one the wall clock proves nothing about other
clocks for SETTLED_S.
"""

from __future__ import annotations

import ctypes
import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

STEP_S = 0.5  # more than two readings of the clocks can lie apart; a leap second counts as a step
SETTLED_S = 60.0  # as long as a command can be valid
ASK_EVERY_S = 10.0
TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised
STA_UNSYNC = 0x0040  # the same in its status

# Touched by systemd-timesyncd(8) at each synchronisation, every 34 minutes at the latest by its default.
TIMESYNC_MARK = Path("/run/systemd/timesync/synchronized")
MARK_VALID_S = 2 * 3600.0

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
READ_WITHIN_S = 0.01

_UNSYNCHRONISED = 'synchronise it; when it is right without: clock = "trusted" in [gateway]'
_DISTRUSTED = 'when it is right: clock = "auto" or "trusted" in [gateway]'

Trust = Literal["auto", "trusted", "untrusted"]


@dataclass(frozen=True, slots=True)
class ClockReading:
    """Both clocks at one moment."""

    up_s: float  # since boot, sleep included
    utc_s: float  # the wall's
    boot_id: str = ""  # of the machine's boot; empty when it cannot be read

    @property
    def offset_s(self) -> float:
        """Return the wall time at which the machine was booted, by the present clock."""
        return self.utc_s - self.up_s


def certain_s(before: ClockReading, now: ClockReading) -> float:
    """Return how long ago `before` was at least, whatever has been done to the wall clock since.

    Over a restart of the machine that is the time since its boot; how long it was off, no other clock says.
    """
    is_same_boot = before.boot_id == now.boot_id
    if is_same_boot and now.up_s >= before.up_s:
        return now.up_s - before.up_s
    return now.up_s


class Clock(Protocol):
    """What the loops need of time; tests give a virtual one."""

    def now_s(self) -> float:
        """Return seconds on a clock that never steps; only differences mean anything."""

    def utc_s(self, at_s: float | None = None) -> float:
        """Return the wall time (seconds since 1970, UTC) of now, or of `at_s` on the steady clock."""

    def reading(self) -> ClockReading:
        """Return the machine's clocks at this moment, by which the next run knows how long ago it was."""


class SystemClock:
    """The machine's own clocks; the steady one is also asyncio's (`loop.time()`)."""

    def now_s(self) -> float:
        """Return `time.monotonic()`."""
        return time.monotonic()

    def utc_s(self, at_s: float | None = None) -> float:
        """Return the wall time; a stamp of the past is carried over by its distance from now."""
        age_s = 0.0 if at_s is None else time.monotonic() - at_s
        return time.time() - age_s

    def reading(self) -> ClockReading:
        """Return `read_clocks()`."""
        return read_clocks()


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


def kernel_says_synchronised() -> bool | None:
    """Return whether the kernel calls the system clock synchronised; None where it does not answer."""
    timex = _Timex()  # modes = 0: only asks
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.byref(timex))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != TIME_ERROR and not timex.status & STA_UNSYNC


def is_kernel_clock_synchronised() -> bool:
    """Return whether a time service keeps the system clock; False when that is unknown.

    A service's sandbox (ProtectClock) forbids the question; there timesyncd's mark must do.
    """
    said = kernel_says_synchronised()
    if said is not None:
        return said
    try:
        return 0 <= time.time() - TIMESYNC_MARK.stat().st_mtime <= MARK_VALID_S
    except OSError:
        return False


def read_clocks() -> ClockReading:
    """Return both clocks of this machine, read as if at one moment."""
    for _ in range(3):  # a process that is held up between the readings must not look like a step
        before_s = time.clock_gettime(time.CLOCK_BOOTTIME)
        utc_s = time.time()
        after_s = time.clock_gettime(time.CLOCK_BOOTTIME)
        if after_s - before_s < READ_WITHIN_S:
            break
    return ClockReading(after_s, utc_s, _boot_id())


@functools.cache
def _boot_id() -> str:
    try:
        return BOOT_ID.read_text("ascii").strip()
    except (OSError, ValueError):
        return ""  # a service's sandbox (ProcSubset) hides it


class ClockWatch:
    """Whether time stamps from elsewhere can be compared with the system clock.

    `on_change` takes the step after which it is not trusted, and None once it is again.
    """

    def __init__(
        self,
        trust: Trust = "auto",
        *,
        ask: Callable[[], bool] = is_kernel_clock_synchronised,
        read: Callable[[], ClockReading] = read_clocks,
    ) -> None:
        self._trust = trust
        self._ask = ask
        self._read = read
        self._offset_s: float | None = None  # before the latest step: smaller ones add up
        self._step: str | None = None  # in words, until the clock was steady for long enough
        self._stepped_s = 0.0
        self._answer = False
        self._asked_s: float | None = None
        self.on_change: Callable[[str | None], None] = lambda _: None

    def reconfigure(self, trust: Trust) -> None:
        """Go by another configuration from now on."""
        self._trust = trust

    def look(self) -> None:
        """Notice a step since the last look; to be called often, and before any command is judged."""
        now = self._read()
        step_s = 0.0 if self._offset_s is None else now.offset_s - self._offset_s
        if self._offset_s is None or abs(step_s) > STEP_S:
            self._offset_s = now.offset_s
        if abs(step_s) > STEP_S:
            self._stepped_s = now.up_s
            way = "ahead" if step_s > 0 else "back"
            self._note(f"this gateway's clock was set {way} by {abs(step_s):.1f} s")
        elif self._step is not None and now.up_s - self._stepped_s >= SETTLED_S:
            self._note(None)

    def doubt(self) -> str | None:
        """Return why the wall clock cannot be compared with others now, with a remedy; None when it can."""
        if self._trust == "untrusted":
            return f"the configuration does not trust this gateway's clock ({_DISTRUSTED})"
        if self._step is not None:
            return f"{self._step}, so issued_at does not count for {SETTLED_S:g} s"
        if self._trust == "auto" and not self._is_synchronised():
            return f"this gateway's clock is not synchronised ({_UNSYNCHRONISED})"
        return None

    def _note(self, step: str | None) -> None:
        self._step = step
        self._asked_s = None  # what the kernel said before does not count
        self.on_change(step)

    def _is_synchronised(self) -> bool:
        """Return what the kernel said at most 10 s ago."""
        now_s = self._read().up_s
        if self._asked_s is None or now_s - self._asked_s >= ASK_EVERY_S:
            self._answer = self._ask()
            self._asked_s = now_s
        return self._answer
