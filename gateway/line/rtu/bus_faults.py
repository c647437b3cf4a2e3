"""Two starters with one address, a second master: recognised by counts of what they leave; pure.

Each sign fills a count that leaks: a single one is everyday life on a shared line, a cause that persists is
not. Two starters that answer for one address leave a second reply to the same request, which says something
else, or bytes that are no frame where others are received well. A second master leaves frames of units that
were not asked. A listed reply (`outstanding.py`) and a reply that comes twice are late, and named as such.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any

from gateway.contract import EventCode
from gateway.line.rtu.reply import first_frame
from gateway.modbus import adu

SOMEONE = 0  # in the place of a unit that cannot be identified

ENOUGH = 4.0  # signs
OTHER_REPLY = 2.0  # a second reply that says something else
MERGED_REPLY = 0.5  # as many bytes as a reply has, or more, but no frame
UNASKED_FRAME = 1.0
LATE_FRAME = 1.0
NOISE = 0.25
LEAK_PER_S = 0.05
REPORTED_AGAIN_AFTER_S = 600.0

RECENTLY_S = 0.15  # a second starter of the same address answers about as soon as the first

# Two that answer for one address corrupt nearly every reply of it, noise corrupts some of every address.
MERGED_SHARE = 0.5  # of a unit's latest replies, before corrupted ones are taken for two that answer at once
UNIT_MEMORY = 0.2  # weight of the latest reply in a unit's share
NOISY_UNIT_SHARE = 0.02

_NOISE_FROM = 4  # bytes; fewer are what drivers make when they switch


@dataclass(frozen=True, slots=True)
class BusFault:
    """A fault of the line: an event, but for the line and its frames."""

    code: EventCode
    unit: int  # SOMEONE when it cannot be identified
    case: str = ""
    fields: Mapping[str, Any] = field(default_factory=dict, compare=False)  # of the event's text


class BusFaults:
    """The signs of one line."""

    def __init__(self) -> None:
        self._replies: dict[int, tuple[bytes, float]] = {}  # the latest of each unit, until it is asked again
        self._signs: dict[BusFault, tuple[float, float]] = {}  # how many, and when they were that many
        self._corrupted: dict[int, float] = {}  # by unit: the share of its latest replies
        self._reported_s: dict[tuple[EventCode, int], float] = {}
        self.news: deque[BusFault] = deque()  # what was recognised; the reader takes it out

    def note_answer(self, unit: int, frame: bytes, at_s: float) -> None:
        """Record that a unit answered as it should."""
        self._replies[unit] = (frame, at_s)
        if self._corrupted.get(unit):
            self._count(unit, is_corrupted=False)

    def note_frame(self, frame: bytes, *, asked: int, is_listed: bool, now_s: float) -> None:
        """Judge a whole frame that was not waited for, after `asked` was asked last."""
        unit = frame[0]
        reply, at_s = self._replies.get(unit, (b"", -inf))
        is_second = unit == asked and now_s - at_s <= RECENTLY_S
        if is_listed or frame == reply:
            self._add(BusFault(EventCode.LATE_REPLIES, SOMEONE), LATE_FRAME, now_s)
        elif is_second:
            self._add(BusFault(EventCode.ADDRESS_CONFLICT, unit), OTHER_REPLY, now_s)
        else:
            self._add(BusFault(EventCode.FOREIGN_TRAFFIC, unit, "unit"), UNASKED_FRAME, now_s)

    def note_noise(self, size: int, now_s: float) -> None:
        """Judge stray bytes that are no frame."""
        if size >= _NOISE_FROM:
            self._add(BusFault(EventCode.FOREIGN_TRAFFIC, SOMEONE, "unknown"), NOISE, now_s)

    def note_garbled(self, unit: int, size: int, reply_size: int | None, now_s: float) -> None:
        """Judge bytes that are no frame, where a unit's reply of this size was expected."""
        self._count(unit, is_corrupted=True)
        is_often = self._corrupted[unit] >= MERGED_SHARE and not self._are_others_corrupted(unit)
        if is_often and reply_size is not None and size >= reply_size:
            self._add(BusFault(EventCode.ADDRESS_CONFLICT, unit), MERGED_REPLY, now_s)

    def note_never_quiet(self, received: bytes, now_s: float) -> None:
        """Record that the line does not become quiet although no unit is asked."""
        unit = _speaker(received)
        fault = BusFault(EventCode.FOREIGN_TRAFFIC, unit, "unknown" if unit == SOMEONE else "unit")
        self._add(fault, ENOUGH, now_s)

    def _add(self, fault: BusFault, weight: float, now_s: float) -> None:
        """Add a sign, and report the fault once there are enough."""
        before, at_s = self._signs.get(fault, (0.0, now_s))
        signs = max(before - LEAK_PER_S * (now_s - at_s), 0.0) + weight
        self._signs[fault] = (min(signs, 2 * ENOUGH), now_s)
        if signs >= ENOUGH:
            self._report(fault, now_s)

    def _count(self, unit: int, *, is_corrupted: bool) -> None:
        before = self._corrupted.get(unit, 0.0)
        self._corrupted[unit] = before + UNIT_MEMORY * (is_corrupted - before)

    def _are_others_corrupted(self, unit: int) -> bool:
        return any(share >= NOISY_UNIT_SHARE for other, share in self._corrupted.items() if other != unit)

    def _report(self, fault: BusFault, now_s: float) -> None:
        cause = (fault.code, fault.unit)
        if now_s - self._reported_s.get(cause, -inf) >= REPORTED_AGAIN_AFTER_S:
            self._reported_s[cause] = now_s
            self.news.append(fault)


def _speaker(received: bytes) -> int:
    """Return the unit of the first reply that can be found in a stream; SOMEONE when there is none."""
    for at in range(len(received) - adu.MIN_ADU_SIZE + 1):
        stray, frame = first_frame(received[at:])
        if frame and not stray:
            return frame[0]
    return SOMEONE
