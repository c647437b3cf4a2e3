"""One starter on a line that keeps order, pure: its replies come late, lost, garbled or refused, by chance.

Each reply carries the number of its request beside the frame, so that one taken for another's cannot hide.
`python -m tests.line.outstanding_model 700000` asks so often for each lateness and prints a table; a second
argument is the share of late replies, a third that of lost ones.
"""

from __future__ import annotations

import random
import sys
from collections import deque
from math import inf
from typing import NamedTuple

from gateway.families.alternates import alternates, fences
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.families.reading import plan_blocks
from gateway.line.rtu.forms import EncodedRequest, FormChoice, Forms
from gateway.line.rtu.outcome import Answered, Refused
from gateway.line.rtu.reply import judge
from gateway.modbus.adu import Adu
from gateway.modbus.pdu import Request, byte_count, encode_exception
from gateway.modbus.reads import ReadCoils, ReadDiscreteInputs
from gateway.modbus.writes import WriteCoil, WriteRegister

UNIT = 1
EVERY_S = 0.25
DEADLINE_S = 0.06  # of a reply
IN_TIME_S = (0.005, 0.03)
STOPS = (WriteCoil(100, is_on=False), WriteCoil(100, is_on=False), WriteCoil(102, is_on=False))
CODES = (1, 2, 3, 6)
LATENESS_S = (0.3, 1.0, 3.0, 30.0)
BUSY_WITH_LATE = 0.2  # late replies x their lateness, or a starter is asked more than it can answer


class Shares(NamedTuple):
    """Of all requests."""

    late: float = 0.05
    lost: float = 0.03
    garbled: float = 0.03
    refused: float = 0.01
    stops: float = 0.02
    writes: float = 0.02


class Coming(NamedTuple):
    """A reply on its way."""

    at_s: float
    number: int  # of the request that it answers
    pdu: bytes  # empty: garbled


class Line:
    """One starter that is asked four times a second."""

    def __init__(
        self, seed: int, *, late_s: float, shares: Shares | None = None, family: str | None = None
    ) -> None:
        self.late_s = late_s
        self.asked = self.answered = self.wrong = self.unsent = 0
        self.longest_s = 0.0  # between two answers
        self.now_s = 0.0
        self._chance = random.Random(seed)
        wanted = shares or Shares()
        self._shares = wanted._replace(late=min(wanted.late, BUSY_WITH_LATE / late_s))
        self._choice = FormChoice()
        profile = load_profile(family or FAMILIES[seed % len(FAMILIES)])
        self._forms = Forms(lambda request: alternates(profile, request), fences(profile))
        self._polls = [block.request for block in plan_blocks(profile, Variant())]
        self._coming: deque[Coming] = deque()
        self._answered_s = 0.0

    def ask(self, count: int) -> None:
        """Ask until so many requests were sent."""
        polls = 0
        while self.asked < count:
            self.now_s += EVERY_S
            kind = self._chance.random()
            if kind < self._shares.stops:
                self._send(EncodedRequest.of(UNIT, self._chance.choice(STOPS)))
            elif kind < self._shares.stops + self._shares.writes:
                self._want(WriteRegister(3, self._chance.randrange(2)), is_poll=False)
            else:
                polls += 1
                is_job = self._chance.random() < 0.1
                request = self._polls[0] if polls % 2 else self._chance.choice(self._polls)
                self._want(request, is_poll=not is_job)

    def _want(self, request: Request, *, is_poll: bool) -> bool:
        """Send a request, behind a fence where it has to be; return whether it was answered."""
        wanted = EncodedRequest.of(UNIT, request)
        sent = self._choice.choose(wanted, self._forms, self.now_s, is_poll=is_poll)
        is_answered = self._send(sent)
        if not sent.is_fence:
            return is_answered
        if is_answered:
            return self._want(request, is_poll=is_poll)
        self.unsent += request.is_write
        return False

    def _send(self, sent: EncodedRequest) -> bool:
        """Send one frame and judge what comes until its deadline; return whether a reply was believed."""
        self._judge_until(self.now_s, None)
        self.asked += 1
        is_own_sent_in_step = sent.request.is_write and sent.request not in STOPS
        assert not is_own_sent_in_step or self._choice.outstanding.is_in_step(UNIT)
        asked_s = self.now_s
        self._answer(sent.request)
        is_believed = self._judge_until(asked_s + DEADLINE_S, sent)
        self.now_s = max(self.now_s, asked_s + DEADLINE_S)
        if not is_believed:
            self._choice.outstanding.add(UNIT, sent.shape, asked_s)
            return False
        self.answered += 1
        self.longest_s = max(self.longest_s, self.now_s - self._answered_s)
        self._answered_s = self.now_s
        return True

    def _answer(self, request: Request) -> None:
        """Let the starter answer, after whatever it has not answered yet."""
        chance, shares = self._chance.random(), self._shares
        at_s = self.now_s + self._chance.uniform(*IN_TIME_S)
        pdu = reply_to(request)
        if (chance := chance - shares.late) < 0.0:
            at_s = self.now_s + self._chance.uniform(DEADLINE_S, self.late_s)
        elif (chance := chance - shares.lost) < 0.0:
            return
        elif (chance := chance - shares.garbled) < 0.0:
            pdu = b""
        elif chance - shares.refused < 0.0:
            pdu = encode_exception(request.function, self._chance.choice(CODES))
        before_s = self._coming[-1].at_s if self._coming else -inf
        self._coming.append(Coming(max(at_s, before_s), self.asked, pdu))

    def _judge_until(self, until_s: float, sent: EncodedRequest | None) -> bool:
        """Judge every frame that comes until then; return whether one was believed."""
        outstanding = self._choice.outstanding
        while self._coming and self._coming[0].at_s <= until_s:
            at_s, number, pdu = self._coming.popleft()
            if not pdu:
                continue
            said = (
                None
                if sent is None
                else judge(UNIT, sent.request, Adu(UNIT, pdu), at_s=at_s, response_time_s=0.0)
            )
            if sent is not None and isinstance(said, Answered | Refused):
                if isinstance(said, Refused) and said.is_lasting:
                    self._choice.give_up(sent, at_s)
                if outstanding.believe(UNIT, pdu):
                    self.wrong += number != self.asked
                    return True
            outstanding.drop(UNIT, pdu)
        return False


def reply_to(request: Request) -> bytes:
    """Return the normal reply, whatever it says."""
    if request.is_write:
        return request.encode()
    count: int = request.count  # type: ignore[attr-defined]  # all are runs
    is_bits = isinstance(request, ReadCoils | ReadDiscreteInputs)
    size = byte_count(count) if is_bits else 2 * count
    return bytes((request.function, size)) + bytes(size)


def main() -> None:
    """Print what so many requests brought, for each lateness."""
    count = int(sys.argv[1])
    shares = Shares(*(float(each) for each in sys.argv[2:4]))
    sys.stdout.write("late up to | family | requests | answered | wrong | longest without an answer\n")
    for late_s in LATENESS_S:
        for seed, family in enumerate(FAMILIES):
            line = Line(seed, late_s=late_s, shares=shares, family=family)
            line.ask(count // len(FAMILIES) // len(LATENESS_S))
            row = f"{late_s:g} s | {family} | {line.asked} | {line.answered} | {line.wrong}"
            sys.stdout.write(f"{row} | {line.longest_s:.1f} s\n")


if __name__ == "__main__":
    main()
