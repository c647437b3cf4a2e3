"""When a line is quiet for long enough that a request may begin [SERIAL 2.5.1.1]."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from gateway.line.port.base import Port
from gateway.line.rtu.strays import Strays
from gateway.line.rtu.transaction import Garbled
from gateway.modbus import LineTiming, adu

BABBLE_LIMIT_S = 1.0  # a line that is busy for longer without our asking is not waited for
STOP_PATIENCE_S = 0.25  # nor, for a stop, one that is busy for longer than this and than the longest frame
STRAY = "??"  # the direction of what was not waited for

_FRAME_GAP = 1.5  # characters

NoteFrame = Callable[[float, str, bytes], None]  # when, which way, and what was on the wire


class Silence:
    """Waits for the silence before a request, and drops what comes meanwhile."""

    def __init__(self, timing: LineTiming, strays: Strays, note_frame: NoteFrame) -> None:
        self._silence_s = timing.silence_s
        self._character_s = timing.character_s
        self._stop_patience_s = max(STOP_PATIENCE_S, adu.MAX_ADU_SIZE * timing.character_s)
        self._strays = strays
        self._note_frame = note_frame
        self._own_end_s = self._listens_until_s = -inf  # no request before: a late reply may be under way
        self._listens_to = 0  # the unit that was asked last
        self._port: Port
        self._time: Callable[[], float]

    def use(self, port: Port, time: Callable[[], float]) -> None:
        """Begin on a port that was just opened: anything may have been on the wire before."""
        self._port, self._time = port, time
        self._own_end_s, self._listens_until_s = time(), -inf
        self._strays.waiting.clear()

    def note_sent(self, end_s: float) -> None:
        """Record when the frame is over that was written just now."""
        self._own_end_s = end_s

    def listen(self, unit: int, until_s: float) -> None:
        """Send nothing until then, unless a reply of this unit ends before."""
        self._listens_to, self._listens_until_s = unit, until_s

    def quiet_from_s(self) -> float:
        """Return when the line will have been silent for long enough, if nothing more comes."""
        return max(self._own_end_s, self._port.last_byte_s) + self._silence_s

    async def settle(
        self,
        *,
        is_for_stop: Callable[[], bool] = lambda: False,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> Garbled | None:
        """Wait until a request may be sent: the line is silent, and what came before is judged.

        Returns None when it may; Garbled when the line does not become quiet within about a second, or within
        a stop's patience as soon as it is for one. `meanwhile` is done where it takes more than a silence.
        """
        began_s = max(self._time(), self._listens_until_s)
        while True:
            quiet_s = self.quiet_from_s()
            if self._strays.waiting and self._time() >= quiet_s:
                self._judge_strays()
            due_s = quiet_s if self._strays.waiting else max(quiet_s, self._listens_until_s)
            if self._strays.waiting or due_s > quiet_s:
                meanwhile()
            chunk = await self._port.read(until_s=due_s)
            if chunk:
                self.drop(chunk)
            elif not self._strays.waiting:
                return None
            now_s = self._time()
            limit_s = self._stop_patience_s if is_for_stop() else BABBLE_LIMIT_S
            if now_s >= began_s + limit_s and now_s < self.quiet_from_s():
                tail = self._strays.give_up(adu.MAX_ADU_SIZE, now_s)
                return Garbled("the line is never quiet", tail, is_sent=False)

    async def find_gap(self, within_s: float) -> None:
        """Wait for the end of a frame, but no longer than this, on a line that is never quiet.

        Inside a frame no pause is longer than 1.5 characters [SERIAL 2.5.1.1].
        """
        until_s = self._time() + within_s
        while (now_s := self._time()) < until_s:
            gap_s = max(self._own_end_s, self._port.last_byte_s) + _FRAME_GAP * self._character_s
            if now_s >= gap_s:
                return
            self.drop(await self._port.read(until_s=min(gap_s, until_s)))

    def drop(self, stray: bytes) -> None:
        """Set aside bytes that were not waited for; they are judged once it is quiet."""
        if stray:
            self._note_frame(self._port.last_byte_s, STRAY, stray)
            self._strays.take(stray)

    def _judge_strays(self) -> None:
        self._strays.judge(self._time())
        if self._listens_to in self._strays.late_units:
            self._listens_until_s = -inf
