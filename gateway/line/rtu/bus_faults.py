"""Two starters with one address, and one that talks unasked: recognised by what they leave on the line; pure.

Two that answer at once leave a second reply to the same request, which says something else, or what no frame
is where others are received well. A reply that is owed (`late_replies.py`), one of another shape and the copy
of one are no sign of that, unless the replies of one unit are doubled and those of no other: they are late or
doubled on the way, and named as such. Each sign fills a bucket that leaks: noise and a single doubled reply
are everyday life on a shared line, a cause that persists is not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any

from gateway.contract import EventCode
from gateway.errors import BadFrameError
from gateway.modbus import adu
from gateway.modbus.codes import EXCEPTION_BIT

SOMEONE = 0  # in the place of a unit that cannot be identified

ENOUGH = 4.0  # signs
OTHER_REPLY = 2.0  # a second reply that says something else
SAME_REPLY = 1.0  # a second reply that says the same
MERGED_REPLY = 0.5  # as many bytes as a reply has, or more, but no frame
UNASKED_FRAME = 1.0
LATE_FRAME = 1.0  # a reply that is owed, or a copy of one
NOISE = 0.25
NEVER_QUIET = ENOUGH

LEAK_PER_ANSWER = 0.1  # of a unit that answers as it should
LEAK_PER_S = 0.05  # of one that talks unasked
REPORTED_AGAIN_AFTER_S = 600.0

COPIED_WITHIN_S = 1.0  # after a reply: an equal one is a copy of it
DOUBLED_WITHIN_S = 60.0  # a way that doubles replies does so to several units

RECENTLY_S = 0.15  # a second starter of the same address answers about as soon as the first

# Two that answer for one address corrupt nearly every reply of it, noise corrupts some of every address.
MERGED_SHARE = 0.5  # of a unit's latest replies, before corrupted ones are taken for two that answer at once
UNIT_MEMORY, LINE_MEMORY = 0.2, 0.01  # weight of the latest reply in a unit's share, and in the line's
NOISY_SHARE = 0.05  # of all replies
NOISY_UNIT_SHARE = 0.02
NOISY_FROM = 50  # replies on

Owes = Callable[[int], bool]  # whether a unit may still answer late

_HEAD = 2  # unit and function
_RECENT = 4  # replies of a unit
_NOISE_FROM = 4  # bytes; fewer are what drivers make when they switch


@dataclass(frozen=True, slots=True)
class BusFault:
    """What is wrong on the line: an event, but for the line and its frames."""

    code: EventCode
    unit: int  # SOMEONE when it cannot be identified
    case: str = ""
    fields: Mapping[str, Any] = field(default_factory=dict)  # of the event's text


class BusFaults:
    """The signs of one line."""

    def __init__(self) -> None:
        self._doubled: dict[int, float] = {}  # by unit
        self._unasked: dict[int, tuple[float, float]] = {}  # by unit: signs, and when they were that many
        self._replies: dict[int, tuple[bytes, float]] = {}  # the latest of each unit, until it is asked again
        self._recent: dict[int, tuple[tuple[bytes, float], ...]] = {}  # the same of any kind, and whenever
        self._copied_s: dict[int, float] = {}  # by unit: the latest copy of a reply
        self._late: dict[int, tuple[float, float]] = {}  # by unit, and of all: signs, as of those unasked
        self._corrupted: dict[int, float] = {}  # by unit: the share of its latest replies
        self._corrupted_of_all = 0.0
        self._counted = 0
        self._reported_s: dict[tuple[EventCode, int], float] = {}
        self._news: list[BusFault] = []

    def take_news(self) -> tuple[BusFault, ...]:
        """Return what was recognised since the last call."""
        news = tuple(self._news)
        self._news.clear()
        return news

    def note_asked(self, unit: int) -> None:
        """Record that a unit is asked: from now on a reply of it is the answer to that."""
        self._replies.pop(unit, None)

    def note_answer(self, unit: int, frame: bytes, *, at_s: float) -> None:
        """Record that a unit answered as it should."""
        self._replies[unit] = (frame, at_s)
        self._note_recent(unit, frame, at_s)
        self._count(unit, is_corrupted=False)
        signs = self._doubled.get(unit)
        if signs is not None:
            self._doubled[unit] = max(signs - LEAK_PER_ANSWER, 0.0)

    def note_stray(self, stray: bytes, *, asked: int, owes: Owes, now_s: float) -> None:
        """Judge bytes that were not waited for, after `asked` was asked."""
        frame = whole_frame(stray)
        if frame is not None:
            self._note_frame(frame.unit, stray, owes=owes, now_s=now_s)
        elif self._is_like_reply(asked, stray) and not self._is_late(asked, now_s):
            self._suspect_conflict(asked, MERGED_REPLY, now_s)
        elif len(stray) >= _NOISE_FROM:
            self._suspect_babble(SOMEONE, NOISE, now_s)

    def note_garbled(
        self, unit: int, received: bytes, *, reply_size: int | None, owes: Owes, now_s: float
    ) -> None:
        """Judge what came instead of the reply that a unit was asked for."""
        frame = whole_frame(received)
        if frame is None:
            self._count(unit, is_corrupted=True)
            self._look_at_noise(now_s)
            is_long_enough = reply_size is not None and len(received) >= reply_size
            is_often = self._corrupted[unit] >= MERGED_SHARE and not self._are_others_corrupted(unit)
            if is_long_enough and is_often and not self._is_late(unit, now_s):
                self._suspect_conflict(unit, MERGED_REPLY, now_s)
        elif frame.unit != unit:
            self._note_frame(frame.unit, received, owes=owes, now_s=now_s)

    def note_never_quiet(self, received: bytes, *, now_s: float) -> None:
        """Record that the line does not become quiet although no unit is asked."""
        self._suspect_babble(_speaker(received), NEVER_QUIET, now_s)

    def _note_frame(self, unit: int, frame: bytes, *, owes: Owes, now_s: float) -> None:
        """Judge a right frame of a unit that is not being asked."""
        reply, at_s = self._replies.get(unit, (b"", -inf))
        is_copy = self._take_copied(unit, frame, now_s)
        is_second = now_s - at_s <= RECENTLY_S and _is_answer_to_the_same(frame, reply)
        if owes(unit):
            self._note_recent(unit, frame, now_s)
            self._note_late(unit, now_s)
        elif is_copy:
            self._note_copy(unit, now_s, is_second=is_second)
        elif is_second:
            self._suspect_conflict(unit, OTHER_REPLY, now_s)
        elif now_s - at_s <= RECENTLY_S:
            self._note_late(unit, now_s)
        else:
            self._suspect_babble(unit, UNASKED_FRAME, now_s)

    def _note_recent(self, unit: int, frame: bytes, at_s: float) -> None:
        self._recent[unit] = (*self._recent.get(unit, ())[1 - _RECENT :], (frame, at_s))

    def _take_copied(self, unit: int, frame: bytes, now_s: float) -> bool:
        """Return whether a frame is the copy of a recent reply; each has one copy at most."""
        recent = self._recent.get(unit, ())
        found = next((one for one in recent if one[0] == frame and now_s - one[1] <= COPIED_WITHIN_S), None)
        if found is not None:
            self._recent[unit] = tuple(one for one in recent if one is not found)
        return found is not None

    def _note_copy(self, unit: int, now_s: float, *, is_second: bool) -> None:
        """Judge a reply that came twice: two starters may say the same, but a way doubles those of all."""
        self._copied_s[unit] = now_s
        others = self._corrupted.keys() - {unit}
        is_only = not any(now_s - self._copied_s.get(other, -inf) <= DOUBLED_WITHIN_S for other in others)
        if is_second and others and is_only:
            self._suspect_conflict(unit, SAME_REPLY, now_s)
        else:
            self._note_late(unit, now_s)

    def _note_late(self, unit: int, now_s: float) -> None:
        """Count a late or doubled reply, and name what makes them once they persist."""
        for cause in (unit, SOMEONE):
            signs = self._late_signs(cause, now_s) + LATE_FRAME
            self._late[cause] = (min(signs, 2 * ENOUGH), now_s)
        if signs >= ENOUGH:
            self._report(BusFault(EventCode.BABBLING, SOMEONE, "late"), now_s)

    def _late_signs(self, unit: int, now_s: float) -> float:
        before, at_s = self._late.get(unit, (0.0, now_s))
        return max(before - LEAK_PER_S * (now_s - at_s), 0.0)

    def _is_late(self, unit: int, now_s: float) -> bool:
        """Return whether replies of a unit were late or doubled a short while ago."""
        return self._late_signs(unit, now_s) > 0.0

    def _count(self, unit: int, *, is_corrupted: bool) -> None:
        self._counted += 1
        before = self._corrupted.get(unit, 0.0)
        self._corrupted[unit] = before + UNIT_MEMORY * (is_corrupted - before)
        self._corrupted_of_all += LINE_MEMORY * (is_corrupted - self._corrupted_of_all)

    def _are_others_corrupted(self, unit: int) -> bool:
        return any(share >= NOISY_UNIT_SHARE for other, share in self._corrupted.items() if other != unit)

    def _look_at_noise(self, now_s: float) -> None:
        """Name noise once it corrupts the replies of several units, or of the only one now and then."""
        corrupted = [unit for unit, share in self._corrupted.items() if share >= NOISY_UNIT_SHARE]
        is_shared = len(corrupted) > 1 or (
            len(self._corrupted) == 1 and max(self._corrupted.values()) < MERGED_SHARE
        )
        if self._counted < NOISY_FROM or self._corrupted_of_all < NOISY_SHARE or not is_shared:
            return
        fault = BusFault(
            EventCode.LINE_NOISE,
            SOMEONE,
            fields={
                "share": self._corrupted_of_all,
                "corrupted": len(corrupted),
                "addresses": len(self._corrupted),
            },
        )
        self._report(fault, now_s)

    def _is_like_reply(self, unit: int, stray: bytes) -> bool:
        return unit in self._replies and stray[:_HEAD] == self._replies[unit][0][:_HEAD]

    def _suspect_conflict(self, unit: int, weight: float, now_s: float) -> None:
        signs = self._doubled[unit] = min(self._doubled.get(unit, 0.0) + weight, 2 * ENOUGH)
        if signs >= ENOUGH:
            self._report(BusFault(EventCode.ADDRESS_CONFLICT, unit), now_s)

    def _suspect_babble(self, unit: int, weight: float, now_s: float) -> None:
        before, at_s = self._unasked.get(unit, (0.0, now_s))
        signs = max(before - LEAK_PER_S * (now_s - at_s), 0.0) + weight
        self._unasked[unit] = (min(signs, 2 * ENOUGH), now_s)
        if signs >= ENOUGH:
            self._report(BusFault(EventCode.BABBLING, unit, "unknown" if unit == SOMEONE else "unit"), now_s)

    def _report(self, fault: BusFault, now_s: float) -> None:
        cause = (fault.code, fault.unit)
        if now_s - self._reported_s.get(cause, -inf) >= REPORTED_AGAIN_AFTER_S:
            self._reported_s[cause] = now_s
            self._news.append(fault)


def _is_answer_to_the_same(frame: bytes, reply: bytes) -> bool:
    """Return whether a frame may answer the request that a reply answers: alike in shape, or one refuses."""
    if (frame[1] | reply[1]) & EXCEPTION_BIT:
        return (frame[1] ^ reply[1]) & ~EXCEPTION_BIT == 0
    return frame[1] == reply[1] and len(frame) == len(reply)


def whole_frame(received: bytes) -> adu.Adu | None:
    """Return the frame that these bytes are, None when they are none."""
    try:
        return adu.decode(received)
    except BadFrameError:
        return None


def _speaker(received: bytes) -> int:
    """Return the unit of the first reply that can be found in a stream; SOMEONE when there is none."""
    for at in range(len(received) - adu.MIN_ADU_SIZE + 1):
        try:
            size = adu.reply_adu_size(received[at : at + adu.MAX_ADU_SIZE])
        except BadFrameError:
            continue
        if size is not None and (frame := whole_frame(received[at : at + size])) is not None:
            return frame.unit
    return SOMEONE
