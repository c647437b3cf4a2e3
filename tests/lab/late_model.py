"""Random lines whose replies come late, never or wrong, but in order; an oracle knows what answers what.

`python -m tests.lab.late_model --seeds 1-20 --requests 100000 --late-s 1 --units 8 --mix` asks so often for
every seed; `--ordered-over-all` is a serial server, `--table` prints status ages, beside those of the same
gateway with an oracle, which gets no reply but that to the request under way. The gateway is entered by the
door of `gateway.line`: each word differs from request to request, so that an older one cannot hide, and the
frames that the line itself reports, in their order, pair an answer with its request.
"""

from __future__ import annotations

import argparse
import asyncio
import heapq
import itertools
import random
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field
from math import inf
from typing import Any
from unittest.mock import patch

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.line import Answered, LineHost, Poll, PollResult, Priority, Refused
from gateway.line.rtu.outstanding import Outstanding
from gateway.modbus.adu import crc16, encode
from gateway.modbus.codes import Function
from gateway.modbus.reads import ReadCoils
from gateway.modbus.server import decode_request
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.bus.faults import Reply
from gateway.starters import StarterSetup, polls_of
from tests.rig.world import RigLoop
from tests.scenarios.line.wires import InOrder

FAMILIES = ("ssw07", "ssw06", "ssw900", "sst")
STATUS = 5001  # the word whose bits are the first coils (ssw07 5.3.2)
TIMING = LineTiming(19200, Framing.parse("8E1"))
LIMIT_S = 0.1  # from then on a reply is late
WRITE_EVERY_S = 1.0  # on a line
STOPS = (WriteCoil(100, is_on=False), WriteCoil(102, is_on=False))  # which are sent out of step, too
WARM_S = 5.0  # by then all units have been asked
USUAL = (0.05, 0.03, 0.01, 0.02, 0.01)  # shares of `InOrder.KINDS` where nothing else is said
MOST = 0.1  # of each kind, where the shares are mixed by chance


@dataclass(frozen=True)
class WayFaults:
    """Shares of replies, and how much later than its time a late one comes at most."""

    late_s: float
    shares: tuple[float, ...] = USUAL
    is_mixed: bool = False  # each way has shares by chance
    is_ordered_over_all: bool = False
    has_oracle: bool = (
        False  # the gateway is: it gets only the reply to the request under way, and lists nothing
    )

    def of_way(self, dice: random.Random) -> InOrder:
        shares = [dice.uniform(0.0, MOST) for _ in USUAL] if self.is_mixed else self.shares
        return InOrder(*shares, late_s=self.late_s)


@dataclass
class OrderTally:
    """Counts of a line; times are the longest of all its units, in seconds."""

    requests: int = 0
    polls: int = 0
    answers: int = 0  # to polls
    wrong_values: int = 0
    wrong_refusals: int = 0
    wrong_acknowledgements: int = 0
    unanswered_s: float = 0.0
    unasked_s: float = 0.0
    status_age_s: float = 0.0
    oracle_age_s: float = 0.0  # of a status to one who knows which request each reply answers
    above_oracle_s: float = 0.0  # the longest age of some row, above the oracle's longest of that row
    ages_s: list[float] = field(default_factory=list, repr=False)  # of a status, when the next one came

    @property
    def wrong(self) -> int:
        return self.wrong_values + self.wrong_refusals + self.wrong_acknowledgements

    def add(self, other: OrderTally) -> None:
        for name, value in vars(other).items():
            mine = getattr(self, name)
            setattr(self, name, max(mine, value) if isinstance(value, float) else mine + value)


@dataclass(slots=True)
class Asked:
    """A request on the wires, and what the oracle knows of its reply."""

    unit: int
    request: Any
    at_s: float
    reading: int  # a number that follows from each of its values
    is_refused: bool = False
    was_in_time: bool = False  # its reply came whole, and before the line gave it up


class OrderedLine:
    """The port of a line (`Port` and `PortOpener`) on which no reply of a unit overtakes another."""

    name = "late"
    last_byte_s = -inf

    def __init__(self, faults: WayFaults, dice: random.Random) -> None:
        self.asked = [Asked(0, ReadCoils(0, 1), -inf, 0)]  # by number, from 1 on
        self._faults, self._dice = faults, dice
        self._arrivals: list[tuple[float, int, bytes]] = []
        self._ways: dict[int, tuple[InOrder, float]] = {}  # and its share of requests dropped while busy
        self._given_up_s = inf  # when the request under way is: the first read behind it lasts so long

    async def __call__(self) -> OrderedLine:
        return self

    def close(self) -> None: ...

    def write(self, frame: bytes) -> None:
        dice, unit, now_s = self._dice, frame[0], asyncio.get_running_loop().time()
        number = len(self.asked)
        asked = Asked(unit, decode_request(frame[1:-2]), now_s, reading=number)
        self.asked.append(asked)
        self._given_up_s = inf
        place = 0 if self._faults.is_ordered_over_all else unit
        if place not in self._ways:
            self._ways[place] = self._faults.of_way(dice), dice.choice((0.0, 0.5, 1.0))
        way, dropped = self._ways[place]
        if way.free_s > now_s and dice.random() < dropped:
            return
        after_s = TIMING.wire_s(len(frame)) + dice.uniform(0.005, 0.02)
        for reply in way.apply(Reply(encode(unit, _reply(asked)), after_s, LIMIT_S), dice):
            asked.is_refused = bool(reply.adu[1:2] > b"\x80")
            at_s = now_s + reply.after_s + TIMING.wire_s(len(reply.adu))
            heapq.heappush(self._arrivals, (at_s, number, reply.adu))

    async def read(self, *, until_s: float, count: int = 1) -> bytes:
        loop, received = asyncio.get_running_loop(), b""
        if self._given_up_s == inf:
            self._given_up_s = until_s
        while True:
            while self._arrivals and self._arrivals[0][0] <= loop.time():
                self.last_byte_s, number, chunk = heapq.heappop(self._arrivals)
                if self._faults.has_oracle and number != len(self.asked) - 1:
                    continue
                is_under_way = number == len(self.asked) - 1 and self.last_byte_s <= self._given_up_s
                self.asked[number].was_in_time = is_under_way and not crc16(chunk)
                received += chunk
            if len(received) >= count or loop.time() >= until_s:
                return received
            wake = loop.create_future()
            next_s = self._arrivals[0][0] if self._arrivals else inf
            loop.call_at(min(until_s, next_s), wake.set_result, None)
            await wake


def _reply(asked: Asked) -> Any:
    if asked.request.is_write:
        return asked.request.encode()  # functions 5 and 6
    return asked.request.encode_reply(value_of(asked, asked.request))


def value_of(asked: Asked, wanted: Any) -> tuple[int, ...]:
    """Return what the registers or coils that are wanted held when this was asked."""
    places = range(wanted.address, wanted.address + wanted.count)
    if wanted.function != Function.READ_COILS:
        return tuple(_word(asked, at) for at in places)
    return tuple(_word(asked, STATUS + at // 16) >> at % 16 & 1 for at in places)


def _word(asked: Asked, at: int) -> int:
    return asked.reading * 40_503 + asked.unit * 4_099 + at * 257 & 0xFFFF


@dataclass(slots=True)
class Unit:
    """When a unit was asked last, and when the request was sent that it answered last."""

    asked_s: float
    answered_s: float


class Status:
    """A row that decides the state: when it was asked for that gateway and oracle believe."""

    def __init__(self, poll: Poll, now_s: float) -> None:
        self.believed_s = self.oracle_s = now_s
        self.longest_s = self.oracle_longest_s = 0.0
        self._forms = {poll.request, *(read for read, _ in poll.forms.alternates_of(poll.request))}

    def is_read_by(self, request: Any) -> bool:
        """Return whether a request reads this row: a fence is no reading, whatever registers it names."""
        return request in self._forms


class OracleJudge:
    """Compares the line's results with what the oracle knows of it."""

    def __init__(self, line: OrderedLine, polls: list[Poll], requests: int) -> None:
        self.tally = OrderTally()
        self.done = asyncio.Event()
        self._line, self._requests, self._sent = line, requests, ""
        self._polls = {poll.key: poll for poll in polls}
        now_s = asyncio.get_running_loop().time()
        self._warm_s = now_s + WARM_S
        self._units = {poll.unit: Unit(now_s, now_s) for poll in polls}
        self._rows = {poll.key: Status(poll, now_s) for poll in polls if poll.group == "status"}

    def frame(self, _line: str, _at_s: float, direction: str, frame: bytes) -> None:
        """See whether this is a request, as the first frame is: then the reply to the one before is known."""
        self._sent = self._sent or direction
        if direction != self._sent:
            return
        known = self.tally.requests
        at_s = self._line.asked[known + 1].at_s
        asked, unit = self._line.asked[known], self._units[frame[0]]
        for key, row in self._rows.items():
            is_known = asked.was_in_time and not asked.is_refused and self._polls[key].unit == asked.unit
            if is_known and row.is_read_by(asked.request):
                row.oracle_s = asked.at_s
            if self._polls[key].unit == frame[0] and at_s > self._warm_s:
                row.longest_s = max(row.longest_s, at_s - row.believed_s)
                row.oracle_longest_s = max(row.oracle_longest_s, at_s - row.oracle_s)
        self._longest("unasked_s", at_s - unit.asked_s)
        self._longest("unanswered_s", at_s - unit.answered_s)
        unit.asked_s = at_s
        self.tally.requests += 1
        if self.tally.requests == self._requests:
            rows = self._rows.values()
            self.tally.status_age_s = max(row.longest_s for row in rows)
            self.tally.oracle_age_s = max(row.oracle_longest_s for row in rows)
            self.tally.above_oracle_s = max(row.longest_s - row.oracle_longest_s for row in rows)
            self.done.set()

    def event(self, event: Any) -> None:
        """Compare a poll's answer with the reply to the request under way."""
        if not isinstance(event, PollResult):
            return
        self.tally.polls += 1
        if not isinstance(event.outcome, Answered | Refused):
            return
        asked, poll = self._line.asked[self.tally.requests], self._polls[event.key]
        self.tally.answers += 1
        self._units[event.unit].answered_s = asked.at_s
        if isinstance(event.outcome, Refused):
            self.tally.wrong_refusals += not (asked.was_in_time and asked.is_refused)
        elif tuple(event.outcome.value) != value_of(asked, poll.request) or asked.unit != event.unit:
            self.tally.wrong_values += 1
        elif row := self._rows.get(event.key):
            self.tally.ages_s.append(asked.at_s - row.believed_s)
            row.believed_s = asked.at_s

    def _longest(self, name: str, seconds: float) -> None:
        if self._line.asked[-1].at_s > self._warm_s:
            setattr(self.tally, name, max(getattr(self.tally, name), seconds))


async def ask(faults: WayFaults, *, seed: int, requests: int, units: int, every_s: float) -> OrderTally:
    """Let a line ask so often, with a write to some unit now and then."""
    dice = random.Random(seed)
    polls: list[Poll] = []
    for at in range(1, units + 1):
        profile = load_profile(FAMILIES[at % len(FAMILIES)])
        polls += polls_of(StarterSetup(f"x{at}", "x", at, profile, Variant(), TIMING, every_s=every_s))
    line = OrderedLine(faults, dice)
    judge = OracleJudge(line, polls, requests)
    host = LineHost(judge.event, has_thread=False)
    host.capture(judge.frame)
    client = host.add_line(name="x", opener=line, timing=TIMING, polls=polls, seed=seed)
    await host.start()
    while not judge.done.is_set():
        await asyncio.sleep(dice.expovariate(1 / WRITE_EVERY_S))
        lane, unit = dice.choice((Priority.COMMAND, Priority.STOP)), dice.randint(1, units)
        write = WriteRegister(3, dice.randrange(2)) if lane is Priority.COMMAND else dice.choice(STOPS)
        outcome = await client.transact(unit, write, response_time_s=LIMIT_S, lane=lane)
        if isinstance(outcome, Answered):
            asked = next(asked for asked in reversed(line.asked) if asked.request.is_write)
            judge.tally.wrong_acknowledgements += asked.is_refused or not asked.was_in_time
    await host.stop()
    return judge.tally


def run(faults: WayFaults, **what: Any) -> OrderTally:
    """Do the same in virtual time."""
    lists = patch.object(Outstanding, "add") if faults.has_oracle else nullcontext()
    with lists, asyncio.Runner(loop_factory=RigLoop) as runner:
        return runner.run(ask(faults, **what))


def table(late_s: float, **what: Any) -> Iterator[str]:
    """Return the rows of the table of status ages."""
    yield "| starters | faults | answered | age, 99.9 % | longest | oracle: answered | 99.9 % | longest |"
    yield "|---|---|---|---|---|---|---|---|"
    for units, (late, lost) in itertools.product((1, 8), ((0, 0.01), (0, 0.05), (0.01, 0), (0.05, 0))):
        cells = [str(units), f"{lost:.0%} lost" if lost else f"{late:.0%} late up to {late_s:g} s"]
        for has_oracle in (False, True):
            faults = WayFaults(late_s, (late, lost, 0, 0, 0), has_oracle=has_oracle)
            found = run(faults, seed=1, units=units, **what)
            quantile_s = sorted(found.ages_s)[len(found.ages_s) * 999 // 1000]
            cells.append(f"{found.answers / found.polls:.1%}")
            cells += [f"{age:.1f} s" for age in (quantile_s, found.status_age_s)]
        yield f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the counts of each seed and of all; exit 1 when anything wrong was believed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1-5", help="FIRST-LAST")
    parser.add_argument("--requests", type=int, default=20_000, help="of each seed")
    parser.add_argument("--late-s", type=float, default=1.0, help="at most 30")
    parser.add_argument("--units", type=int, default=1)
    parser.add_argument("--every-s", type=float, default=0.25)
    for flag in ("ordered-over-all", "mix", "table"):
        parser.add_argument(f"--{flag}", action="store_true")
    given = parser.parse_args()
    if given.table:
        for line in table(given.late_s, requests=given.requests, every_s=given.every_s):
            print(line, flush=True)
        return
    faults = WayFaults(given.late_s, is_mixed=given.mix, is_ordered_over_all=given.ordered_over_all)
    first, _, last = given.seeds.partition("-")
    total = OrderTally()
    for seed in range(int(first), int(last or first) + 1):
        found = run(faults, seed=seed, requests=given.requests, units=given.units, every_s=given.every_s)
        print(f"seed {seed}: {found}", flush=True)
        total.add(found)
    print(f"all: {total}")
    sys.exit(1 if total.wrong else 0)


if __name__ == "__main__":
    main()
