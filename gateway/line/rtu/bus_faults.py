"""Two starters with one address, and one that talks unasked: recognised by what they leave on the line; pure.

Each sign fills a bucket that leaks: noise and a single doubled reply are everyday life on a shared line, a
cause that persists is not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from gateway.errors import BadFrameError
from gateway.modbus import adu

ADDRESS_CONFLICT, BABBLING, LINE_NOISE = "address_conflict", "babbling", "line_noise"
SOMEONE = 0  # in the place of a unit that cannot be told

ENOUGH = 4.0  # signs
OTHER_REPLY = 2.0  # a second reply that says something else
SAME_REPLY = 1.0  # a second reply that says the same
MERGED_REPLY = 0.5  # as many bytes as a reply has, or more, but no frame
UNASKED_FRAME = 1.0
NOISE = 0.25
NEVER_QUIET = ENOUGH

LEAK_PER_ANSWER = 0.1  # of a unit that answers as it should
LEAK_PER_S = 0.05  # of one that talks unasked
TOLD_AGAIN_AFTER_S = 600.0

RECENTLY_S = 0.15  # a second starter of the same address answers about as soon as the first

# Two that answer for one address spoil nearly every reply of it, noise spoils some of every address.
MERGED_SHARE = 0.5  # of a unit's latest replies, before spoilt ones are taken for two that answer at once
UNIT_MEMORY, LINE_MEMORY = 0.2, 0.01  # weight of the latest reply in a unit's share, and in the line's
NOISY_SHARE = 0.05  # of all replies
NOISY_UNIT_SHARE = 0.02
NOISY_FROM = 50  # replies on

Owes = Callable[[int], bool]  # whether a unit may still answer late

_HEAD = 2  # unit and function
_NOISE_FROM = 4  # bytes; fewer are what drivers make when they switch


@dataclass(frozen=True, slots=True)
class BusFault:
    """What is wrong on the line, by name."""

    code: str
    unit: int  # SOMEONE when it cannot be told
    text: str


class BusFaults:
    """The signs of one line."""

    def __init__(self) -> None:
        self._doubled: dict[int, float] = {}  # by unit
        self._unasked: dict[int, tuple[float, float]] = {}  # by unit: signs, and when they were that many
        self._replies: dict[int, tuple[bytes, float]] = {}  # the latest of each unit, until it is asked again
        self._spoilt: dict[int, float] = {}  # by unit: the share of its latest replies
        self._spoilt_of_all = 0.0
        self._counted = 0
        self._told_s: dict[tuple[str, int], float] = {}
        self._news: list[BusFault] = []

    def take_news(self) -> tuple[BusFault, ...]:
        """Return what was recognised since the last call."""
        news, self._news = self._news, []
        return tuple(news)

    def note_asked(self, unit: int) -> None:
        """Take over that a unit is asked: from now on a reply of it is the answer to that."""
        self._replies.pop(unit, None)

    def note_answer(self, unit: int, frame: bytes, *, at_s: float) -> None:
        """Take over that a unit answered as it should."""
        self._replies[unit] = (frame, at_s)
        self._count(unit, is_spoilt=False)
        signs = self._doubled.get(unit)
        if signs is not None:
            self._doubled[unit] = max(signs - LEAK_PER_ANSWER, 0.0)

    def note_stray(self, stray: bytes, *, asked: int, owes: Owes, now_s: float) -> None:
        """Take over bytes that nobody waited for, after `asked` was."""
        frame = whole_frame(stray)
        if frame is not None:
            self._note_frame(frame.unit, stray, owes=owes, now_s=now_s)
        elif self._is_like_reply(asked, stray):
            self._suspect_conflict(asked, MERGED_REPLY, now_s)
        elif len(stray) >= _NOISE_FROM:
            self._suspect_babble(SOMEONE, NOISE, now_s)

    def note_garbled(
        self, unit: int, received: bytes, *, reply_size: int | None, owes: Owes, now_s: float
    ) -> None:
        """Take over what came instead of the reply that a unit was asked for."""
        frame = whole_frame(received)
        if frame is None:
            self._count(unit, is_spoilt=True)
            self._look_at_noise(now_s)
            is_long_enough = reply_size is not None and len(received) >= reply_size
            if is_long_enough and self._spoilt[unit] >= MERGED_SHARE and not self._are_others_spoilt(unit):
                self._suspect_conflict(unit, MERGED_REPLY, now_s)
        elif frame.unit != unit:
            self._note_frame(frame.unit, received, owes=owes, now_s=now_s)

    def note_never_quiet(self, heard: bytes, *, now_s: float) -> None:
        """Take over that the line does not become quiet although nobody is asked."""
        self._suspect_babble(_speaker(heard), NEVER_QUIET, now_s)

    def _note_frame(self, unit: int, frame: bytes, *, owes: Owes, now_s: float) -> None:
        """Judge a right frame of a unit that is not being asked."""
        reply, at_s = self._replies.get(unit, (b"", -inf))
        if now_s - at_s <= RECENTLY_S:
            self._suspect_conflict(unit, SAME_REPLY if frame == reply else OTHER_REPLY, now_s)
        elif not owes(unit):
            self._suspect_babble(unit, UNASKED_FRAME, now_s)

    def _count(self, unit: int, *, is_spoilt: bool) -> None:
        self._counted += 1
        before = self._spoilt.get(unit, 0.0)
        self._spoilt[unit] = before + UNIT_MEMORY * (is_spoilt - before)
        self._spoilt_of_all += LINE_MEMORY * (is_spoilt - self._spoilt_of_all)

    def _are_others_spoilt(self, unit: int) -> bool:
        return any(share >= NOISY_UNIT_SHARE for other, share in self._spoilt.items() if other != unit)

    def _look_at_noise(self, now_s: float) -> None:
        """Name noise once it spoils the replies of several units, or of the only one now and then."""
        spoilt = [unit for unit, share in self._spoilt.items() if share >= NOISY_UNIT_SHARE]
        is_shared = len(spoilt) > 1 or (len(self._spoilt) == 1 and max(self._spoilt.values()) < MERGED_SHARE)
        if self._counted < NOISY_FROM or self._spoilt_of_all < NOISY_SHARE or not is_shared:
            return
        text = (
            f"noise: some {self._spoilt_of_all:.0%} of the replies are corrupted, of {len(spoilt)} of "
            f"{len(self._spoilt)} addresses; look at shield, reference and termination"
        )
        self._tell(BusFault(LINE_NOISE, SOMEONE, text), now_s)

    def _is_like_reply(self, unit: int, stray: bytes) -> bool:
        return unit in self._replies and stray[:_HEAD] == self._replies[unit][0][:_HEAD]

    def _suspect_conflict(self, unit: int, weight: float, now_s: float) -> None:
        signs = self._doubled[unit] = min(self._doubled.get(unit, 0.0) + weight, 2 * ENOUGH)
        if signs >= ENOUGH:
            text = f"address {unit} seems to be given twice: what is asked of it is answered more than once"
            self._tell(BusFault(ADDRESS_CONFLICT, unit, text), now_s)

    def _suspect_babble(self, unit: int, weight: float, now_s: float) -> None:
        before, at_s = self._unasked.get(unit, (0.0, now_s))
        signs = max(before - LEAK_PER_S * (now_s - at_s), 0.0) + weight
        self._unasked[unit] = (min(signs, 2 * ENOUGH), now_s)
        if signs >= ENOUGH:
            who = "someone on the line" if unit == SOMEONE else f"unit {unit}"
            self._tell(BusFault(BABBLING, unit, f"{who} talks without being asked"), now_s)

    def _tell(self, trouble: BusFault, now_s: float) -> None:
        cause = (trouble.code, trouble.unit)
        if now_s - self._told_s.get(cause, -inf) >= TOLD_AGAIN_AFTER_S:
            self._told_s[cause] = now_s
            self._news.append(trouble)


def whole_frame(heard: bytes) -> adu.Adu | None:
    """Return the frame that these bytes are, None when they are none."""
    try:
        return adu.decode(heard)
    except BadFrameError:
        return None


def _speaker(heard: bytes) -> int:
    """Return the unit of the first reply that can be found in a stream; SOMEONE when there is none."""
    for at in range(len(heard) - adu.MIN_ADU_SIZE + 1):
        try:
            size = adu.reply_adu_size(heard[at : at + adu.MAX_ADU_SIZE])
        except BadFrameError:
            continue
        if size is not None and (frame := whole_frame(heard[at : at + size])) is not None:
            return frame.unit
    return SOMEONE
