"""What follows from what the judge saw: efficiency, broken silences, shares of the line's time. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from math import ceil
from typing import NamedTuple

from gateway.modbus.timing import LineTiming

TOO_SOON_S = 0.00005  # a request may start so much before the silence is over: clocks and wake-ups
CROSSING_S = 0.001  # on its way to the line for so long at most: what begins meanwhile goes first


class SeenRequest(NamedTuple):
    """One request on a line, and its reply if there was one; times on the clock that all processes share."""

    line: int
    start_s: float  # first byte of the request on the wire
    unit: int
    function: int
    request_size: int  # bytes
    reply_size: int  # bytes; 0 when there was no reply
    end_s: float  # last byte of the reply, or of the request when there was no reply
    gap_s: float  # silence before the request; negative when it cut into another frame
    late_s: float  # by so much the judge missed the reply's due time

    @property
    def is_write(self) -> bool:
        """Whether the request writes [APP 6.5, 6.6, 6.11, 6.12]."""
        return self.function in (5, 6, 15, 16)


@dataclass(frozen=True, slots=True)
class Law:
    """What the line allows at best."""

    timing: LineTiming
    delay_s: float  # from the request's last byte to the reply's first

    def ideal_s(self, seen: SeenRequest) -> float:
        """Return request, delay, reply and one silence."""
        wire_s = self.timing.wire_s(seen.request_size + seen.reply_size)
        return wire_s + self.delay_s + self.timing.silence_s

    def is_too_soon(self, seen: SeenRequest) -> bool:
        """Return whether a request broke the silence."""
        return seen.gap_s < self.timing.silence_s - TOO_SOON_S


@dataclass(frozen=True, slots=True)
class Account:
    """A line's time in one run."""

    answered: int
    efficiency: float  # of answered polls: ideal / time until the next request, the median
    efficiency_low: float  # the same, the tenth of all that is worst
    whole: float  # sum of the answered polls' ideal times / all time
    silent_share: float  # of all time that went to requests without a reply
    too_soon: int
    idle_s: float  # median silence beyond the one that must be
    requests: int


def account(seen: Sequence[SeenRequest], law: Law) -> Account:
    """Evaluate one run; requests of several lines may be mixed."""
    pairs = list(_neighbours(seen))
    answered = [(each, following) for each, following in pairs if each.reply_size]
    # What the judge handed over late is not the master's fault.
    ratios = [law.ideal_s(each) / (_period_s(each, following) - each.late_s) for each, following in answered]
    total_s = sum(_period_s(*pair) for pair in pairs)
    silent_s = sum(_period_s(*pair) for pair in pairs if not pair[0].reply_size)
    return Account(
        answered=len(answered),
        efficiency=quantile(ratios, 0.5),
        efficiency_low=quantile(ratios, 0.1),
        whole=sum(law.ideal_s(each) for each, _ in answered) / total_s if total_s else 0.0,
        silent_share=silent_s / total_s if total_s else 0.0,
        too_soon=sum(law.is_too_soon(each) for each in seen),
        idle_s=quantile([following.gap_s - law.timing.silence_s for _, following in answered], 0.5),
        requests=len(seen),
    )


def between(seen: Iterable[SeenRequest], from_s: float, to_s: float) -> list[SeenRequest]:
    """Return what started in a span of time."""
    return [each for each in seen if from_s <= each.start_s < to_s]


def sweeps_s(seen: Iterable[SeenRequest]) -> list[float]:
    """Return the times between two requests to the same unit of the same line."""
    starts_s: dict[tuple[int, int], list[float]] = {}
    for each in seen:
        starts_s.setdefault((each.line, each.unit), []).append(each.start_s)
    return [later_s - sooner_s for times_s in starts_s.values() for sooner_s, later_s in pairwise(times_s)]


class Submitted(NamedTuple):
    """A stop as it was given, on the clock that all processes share."""

    sent_s: float
    at_s: float  # when it reached the master, as far as that can be seen from outside
    unit: int


@dataclass(frozen=True, slots=True)
class Stop:
    """One stop: how long it waited, and how much of that the line did not ask for."""

    latency_s: float  # from its submission to its first byte on the wire
    excess_s: float  # beyond the end of the transaction that it waited for, and its silence
    under_way_s: float  # the length of that transaction, silence included
    is_crossed: bool  # that transaction began while the stop was on its way to the line


def stops(seen: Sequence[SeenRequest], submitted: Iterable[Submitted], law: Law) -> list[Stop]:
    """Match the stops of one line, each with the first write to its unit after it was sent.

    It waits for what is on the line when it is submitted, or begins within CROSSING_S after that.
    """
    found: list[Stop] = []
    for stop in submitted:
        after = (each for each in seen if each.start_s > stop.sent_s)
        first = next((each for each in after if each.unit == stop.unit and each.is_write), None)
        before = [each for each in seen if each.start_s <= stop.at_s + CROSSING_S and each is not first]
        if not before or first is None:
            continue
        free_s = before[-1].end_s + law.timing.silence_s
        under_way_s = free_s - before[-1].start_s
        excess_s = first.start_s - max(stop.at_s, free_s)
        found.append(
            Stop(first.start_s - stop.at_s, excess_s, under_way_s, is_crossed=before[-1].start_s > stop.at_s)
        )
    return found


def quantile(values: Iterable[float], share: float) -> float:
    """Return the smallest value that at least this share does not exceed; NaN of nothing."""
    ordered = sorted(values)
    return ordered[max(ceil(share * len(ordered)) - 1, 0)] if ordered else float("nan")


def _neighbours(seen: Sequence[SeenRequest]) -> Iterator[tuple[SeenRequest, SeenRequest]]:
    for _, one_line in groupby(sorted(seen), key=lambda each: each.line):
        yield from pairwise(one_line)


def _period_s(each: SeenRequest, following: SeenRequest) -> float:
    return following.start_s - each.start_s
