"""When the gateway hangs, writes all stacks to stderr before the service manager ends it.

faulthandler's C thread writes them: it needs neither a loop nor Python's lock, so it always works.
"""

from __future__ import annotations

import faulthandler
import logging
import sys
import time
from collections.abc import Callable
from typing import Any

log = logging.getLogger(__name__)

QUIET_S = 600.0  # between dumps: repeated stalls must not fill the journal


class HangWatch:
    """Armed by every sign of life; a dump follows when none came for half the service watchdog's limit."""

    def __init__(
        self,
        patience_s: float | None,
        *,
        arm: Callable[..., Any] = faulthandler.dump_traceback_later,
        disarm: Callable[[], Any] = faulthandler.cancel_dump_traceback_later,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._patience_s = patience_s
        self._arm = arm
        self._disarm = disarm
        self._clock = clock
        self._fed_s: float | None = None
        self._dumped_s = float("-inf")
        self.dumps = 0

    def fed(self) -> None:
        """Record a sign of life: the dump is now due later."""
        if self._patience_s is None:
            return
        now_s = self._clock()
        if self._fed_s is not None and now_s - self._fed_s >= self._patience_s:
            self._note_stall(now_s, now_s - self._fed_s)
        self._fed_s = now_s
        if now_s - self._dumped_s >= QUIET_S:
            self._arm(self._patience_s, file=sys.__stderr__)

    def close(self) -> None:
        """Dump nothing more."""
        if self._patience_s is not None:
            self._disarm()

    def _note_stall(self, now_s: float, stalled_s: float) -> None:
        self.dumps += 1
        if now_s - self._dumped_s >= QUIET_S:
            self._dumped_s = now_s
            where = "its stacks are above, unless the machine stopped it"
            log.error("the gateway stood still for %.1f s; %s", stalled_s, where)
        self._disarm()
