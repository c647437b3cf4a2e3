"""Asks the starters of lines that are late to different degrees, and counts what is taken for what.

`python -m tests.line.late_lines 10000000` asks as often as that, in as many processes as there are cores;
a second number says in how many processes.
"""

from __future__ import annotations

import os
import random
import sys
from collections import Counter, deque
from collections.abc import Coroutine
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields
from functools import partial
from math import inf
from typing import Any, TypeVar

from gateway.families.alternates import alternates
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.families.reading import plan_blocks
from gateway.line.events import Trace
from gateway.line.rtu.late_replies import LOOK_AGAIN_S, Agreed
from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused
from gateway.line.rtu.request import Alternate, EncodedRequest
from gateway.line.rtu.transaction import RtuMaster
from gateway.modbus.codes import Function
from gateway.modbus.pdu import Request
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister
from tests.line.late_wire import ALLOWANCE_S, Faults, LateWire, bits, words
from tests.starters.lost_lines import table

T = TypeVar("T")

FAMILIES = ("ssw06", "ssw07", "ssw900", "sst")
BAUDS = (9600, 19200, 57600)
UNITS = (1, 1, 2, 3, 8, 32, 120, 247)
ON_A_LINE = 5000  # requests
WRITES = 0.01  # of all requests
REFUSED = 0.03  # of all blocks
LIMITS_S = (0.010, 0.020, 0.100)
FULL, LIGHT_S = 0.0, (0.3, 1.0)
SLOW_CHANGES = (0.003, 0.05)  # shares of the requests before which what the starters say changes
LOST = (0.05, 0.8)  # shares of the missing or faulty replies that never come, where some do not
PARTS = 20  # of all requests, each with a seed of its own
MOST_LOOKS = 40  # at what is due, before it is waited for something to become due


@dataclass
class Tally:
    """What became of all requests."""

    counts: Counter[str] = field(default_factory=Counter)  # by the kind of reply
    answered: int = 0
    asked: int = 0
    alternates: int = 0  # sent in place of the request itself
    series: int = 0  # answers that counted since enough before them were equal
    wrong: int = 0  # answers that were another request's
    mixed: int = 0  # of two replies within one another, whose CRC was right by chance
    since: int = 0  # acknowledgements in doubt of which it is known since when the write was sent
    older: int = 0  # answers to the same request, sent less than `OLDER_S` before
    examples: list[str] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Count another's beside one's own."""
        for each in fields(self):
            setattr(self, each.name, getattr(self, each.name) + getattr(other, each.name))


OLDER_S = 0.1


@dataclass
class _Asked:
    """One read of one unit, asked again and again."""

    unit: int
    encoded: EncodedRequest
    alternates: tuple[Alternate, ...]
    every_s: float
    due_s: float
    before: deque[tuple[int, float]] = field(default_factory=deque)  # numbers of its replies, when asked for
    is_decisive: bool = False  # it says in which state its starter is
    series_from: int = 0  # the number at the first request of a series; 0: none is under way


class Line:
    """One line with its starters, asked until enough."""

    def __init__(
        self, chance: random.Random, faults: Faults, *, units: int, baud: int, every_s: float
    ) -> None:
        self.tally = Tally()
        self._chance = chance
        self._timing = LineTiming(baud, Framing.parse("8E1"))
        self._limit_s = chance.choice(LIMITS_S)
        self.wire = LateWire(self._timing, chance, faults, limit_s=self._limit_s)
        self._line = RtuMaster(
            self.wire,
            self._timing,
            allowance_s=ALLOWANCE_S,
            note_frame=Trace("late").note,
            time=self.wire.time,
        )
        self._asked = deque(self._reads(units, every_s))
        self._written = (b"", 0, -inf)  # the latest write, its number, when
        self._writes: deque[tuple[bytes, int, float]] = deque(maxlen=1000)

    def ask(self, count: int) -> Tally:
        """Send so many requests."""
        while self.wire.asked < count:
            run(self._ask_next())
        self.tally.asked += self.wire.asked
        self.tally.counts += self.wire.counts
        return self.tally

    def _reads(self, units: int, every_s: float) -> list[_Asked]:
        chance, found = self._chance, []
        for unit in range(1, units + 1):
            family = chance.choice(FAMILIES)
            blocks = _BLOCKS[family]
            for request, others, is_decisive in chance.sample(blocks, chance.randint(1, min(len(blocks), 4))):
                due_s = chance.uniform(0.0, every_s)
                read = _Asked(unit, EncodedRequest.of(unit, request), others, every_s, due_s)
                read.is_decisive = is_decisive
                found.append(read)
                if chance.random() < REFUSED:
                    self.wire.refused.add((unit, request.address))  # type: ignore[attr-defined]
        chance.shuffle(found)
        return found

    async def _ask_next(self) -> None:
        """Send what is due first and may be sent."""
        await self._line.settle()
        if self._chance.random() < WRITES:
            await self._write(self._chance.choice(self._asked).unit)
            return
        now_s, waits_until_s = self.wire.now_s, inf
        for _ in range(min(len(self._asked), MOST_LOOKS)):
            read = self._asked.popleft()
            self._asked.append(read)
            if read.due_s > now_s:
                waits_until_s = min(waits_until_s, read.due_s)
                continue
            form = self._form_of(read)
            if form is not None:
                await self._read(read, form)
                return
            waits_until_s = min(
                waits_until_s, self._line.late.free_from_s(read.unit, read.encoded.request, now_s)
            )
        if len(self._asked) > MOST_LOOKS:
            waits_until_s = min(waits_until_s, now_s + 0.001)
        await self._line.settle(waits_until_s)

    def _form_of(self, read: _Asked) -> EncodedRequest | None:
        form = self._line.forms.choose(
            read.encoded,
            lambda _: read.alternates,
            self.wire.now_s,
            is_decisive=read.is_decisive,
            is_patient=True,
        )
        if form is not None and form.times == 1:
            read.series_from = 0
        return form

    async def _read(self, read: _Asked, form: EncodedRequest) -> None:
        began_s = self.wire.now_s
        outcome = await self._line.exchange(form, response_time_s=self._limit_s)
        if form.times > 1 and isinstance(outcome, Answered) and not self._agrees(read, form, outcome):
            self._asked.remove(read)
            self._asked.appendleft(read)  # once more at once, or when it may
            return
        self._check(read, form, outcome, began_s)
        read.series_from = 0
        read.due_s = max(read.due_s + read.every_s, self.wire.now_s)
        self.tally.alternates += form is not read.encoded
        self.tally.answered += isinstance(outcome, (Answered, Refused))

    def _agrees(self, read: _Asked, form: EncodedRequest, outcome: Answered) -> bool:
        """Return whether a series is complete with this answer."""
        if read.series_from == 0:
            read.series_from = self.wire.changed
        agreed = self._line.agrees(form, outcome)
        if agreed is Agreed.NO:
            read.series_from = 0
            read.due_s = max(read.due_s, self.wire.now_s + LOOK_AGAIN_S)
        self.tally.series += agreed is Agreed.YES
        return agreed is Agreed.YES

    def _check(self, read: _Asked, form: EncodedRequest, outcome: Outcome, began_s: float) -> None:
        """See whether what is taken for the answer is the answer to the latest request."""
        number, part = self.wire.changed, read.encoded.request
        while read.before and began_s - read.before[0][1] > OLDER_S:
            read.before.popleft()
        before = [earlier for earlier, _ in read.before]
        read.before.append((number, began_s))
        is_refused = (read.unit, form.request.address) in self.wire.refused  # type: ignore[attr-defined]
        if isinstance(outcome, Refused):
            is_wrong = not is_refused
        elif isinstance(outcome, Answered):
            numbers = range(read.series_from or number, number + 1)  # said while this was being read
            is_wrong = is_refused or all(outcome.value != _expected(read.unit, at, part) for at in numbers)
            if is_wrong and not is_refused:  # a copy may say what was so a moment before
                is_older = any(outcome.value == _expected(read.unit, earlier, part) for earlier in before)
                self.tally.older += is_older
                is_wrong = not is_older
        else:
            return
        if is_wrong and self.wire.mixed == self.wire.asked:
            self.tally.mixed += 1
        elif is_wrong:
            self._note_wrong(f"{self.wire.asked}: {read.unit} {form.request} {outcome}")

    async def _write(self, unit: int) -> None:
        """Write one of two words: an acknowledgement may look like that of an earlier write."""
        began_s = self.wire.now_s
        encoded = EncodedRequest.of(unit, WriteRegister(3, self._chance.randrange(2)))
        before, self._written = self._written, (encoded.adu, self.wire.asked + 1, began_s)
        outcome = await self._line.exchange(encoded, response_time_s=self._limit_s)
        if isinstance(outcome, Answered) and self.wire.answered != self.wire.asked:
            number, older_s = before[1:]
            if before[0] == encoded.adu and self.wire.answered == number and began_s - older_s <= OLDER_S:
                self.tally.older += 1  # the same was written a moment before
            else:
                self._note_wrong(f"{self.wire.asked}: {unit} write acknowledged by {self.wire.answered}")
        self._writes.append((encoded.adu, self.wire.asked, began_s))
        if isinstance(outcome, Garbled) and outcome.acknowledges_since_s > -inf:
            self._check_since(encoded.adu, outcome.acknowledges_since_s)

    def _check_since(self, written: bytes, since_s: float) -> None:
        """See whether an equal write that was sent since then was acknowledged."""
        self.tally.since += 1
        known = set(self.wire.whole)
        since = {number for frame, number, at_s in self._writes if frame == written and at_s >= since_s}
        if not since & known and self.wire.mixed != self.wire.asked:
            self._note_wrong(f"{self.wire.asked}: nothing written since {since_s} was acknowledged")

    def _note_wrong(self, text: str) -> None:
        self.tally.wrong += 1
        if len(self.tally.examples) < 5:
            self.tally.examples.append(text)


def run(work: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine that never has to wait."""
    try:
        work.send(None)
    except StopIteration as done:
        return done.value  # type: ignore[no-any-return]  # what the coroutine returns
    raise AssertionError("it waits for something")


def ask_for_long(transactions: int, *, seed: int) -> Tally:
    """Ask the starters of all kinds of lines, full and light, with all that can be wrong with replies."""
    chance = random.Random(seed)
    tally = Tally()
    while tally.asked < transactions:
        changes = 1.0 if chance.random() < 0.5 else chance.uniform(*SLOW_CHANGES)
        lost = 0.0 if chance.random() < 0.5 else chance.uniform(*LOST)
        faults = Faults(chance.uniform(0.01, 0.10), lost=lost, stalls=chance.random() < 0.3, changes=changes)
        every_s = FULL if chance.random() < 0.5 else chance.uniform(*LIGHT_S)
        line = Line(chance, faults, units=chance.choice(UNITS), baud=chance.choice(BAUDS), every_s=every_s)
        tally.add(line.ask(min(ON_A_LINE, transactions - tally.asked)))
    return tally


def _expected(unit: int, number: int, request: Request) -> Any:
    address, count = request.address, request.count  # type: ignore[attr-defined]  # all are runs
    if request.function == Function.READ_COILS:
        return bits(unit, number, address, count)
    return words(unit, number, address, count)


def _blocks(family: str) -> list[tuple[Request, tuple[Alternate, ...], bool]]:
    profile = load_profile(family)
    timing = LineTiming(19200, Framing.parse("8E1"))
    blocks = plan_blocks(profile, Variant(), timing=timing)
    return [(each.request, alternates(profile, each.request), each.group == "status") for each in blocks]


_BLOCKS = {family: _blocks(family) for family in FAMILIES}


def main() -> None:
    """Print what so many requests brought."""
    transactions = int(sys.argv[1])
    processes = int(sys.argv[2]) if len(sys.argv) > 2 else os.cpu_count() or 1
    tally = Tally()
    with ProcessPoolExecutor(processes) as pool:
        for part in pool.map(partial(_ask_part, transactions // PARTS), range(PARTS)):
            tally.add(part)
            sys.stderr.write(f"{tally.asked} requests, {tally.wrong} wrong\n")
    lines = [
        f"requests {tally.asked}, answered {tally.answered}, replies {dict(tally.counts)}",
        f"alternates {tally.alternates}, series {tally.series}",
        f"wrong {tally.wrong}, the same read of a moment before {tally.older}, "
        f"of two replies within one another, the CRC being right by chance {tally.mixed}",
        *tally.examples[:5],
        "replies lost, none late, in ten minutes, of the answers without loss:",
        *table(),
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    sys.exit(1 if tally.wrong else 0)


def _ask_part(transactions: int, seed: int) -> Tally:
    return ask_for_long(transactions, seed=seed)


if __name__ == "__main__":
    main()
