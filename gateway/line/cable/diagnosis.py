"""What the pattern of errors along a line says of its cable, in sentences.

Rules, the starters in the order in which the cable passes them
 1. A starter that does not answer at all is off or away, not a fault of the cable; two or more of them at
    the end of a line on which all before them answer are one.
 2. Errors of all starters: termination, bias, noise, or the cable before the first one.
 3. Errors from one starter on up to the end: the cable before it.
 4. Errors of one starter among good ones: its connector, its address, or the starter itself.
 5. Late replies are no fault of the cable: they are a matter of the starter's response time; of all starters,
    of the adapter's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from gateway.contract import EventCode, phrase
from gateway.line.cable.counts import ENOUGH, Counts, bounds

ALIKE = 0.25  # of the bad ones' common share: a starter of which nothing is sure yet counts as one of them
_ERRORS = frozenset({"sole", "all", "one", "from", "up_to", "some"})  # kinds of findings
MOST_NAMED = 6  # starters in a sentence


class WiredStarter(NamedTuple):
    """A starter at its place along the cable."""

    name: str
    address: int
    response_time_s: float  # how long it may take to a read


class Fact(NamedTuple):
    """What is sure of one starter."""

    starter: WiredStarter
    counts: Counts  # those that decided
    span: str  # over which they were counted
    is_offline: bool = False
    is_bad: bool = False  # more replies are corrupted or lost than can be by chance
    is_undecided: bool = False  # too few requests to say that none of this is so
    late: Counts | None = None  # when more replies come too late than can be by chance
    p99_s: float | None = None  # response time, when it is close to the limit

    @property
    def share(self) -> float:
        """The share of corrupted and lost replies."""
        return self.counts.bad / self.counts.asked if self.counts.asked else 0.0


class CableFinding(NamedTuple):
    """One sentence; two of the same kind and starters are the same finding with other numbers."""

    kind: str
    names: tuple[str, ...]
    text: str

    @property
    def group(self) -> str:
        """What it is about: of a group one holds at a time, but of slow starters each has its own."""
        return "errors" if self.kind in _ERRORS else f"{self.kind} {self.names}"

    @property
    def key(self) -> tuple[str, tuple[str, ...]]:
        """What makes it this finding."""
        return self.kind, self.names


def findings(facts: Sequence[Fact], *, more: str = "") -> list[CableFinding]:
    """Return what is wrong on a line; `more` is what the port itself has counted, in words."""
    return [*_silent_end(facts), *_errors(facts, more), *_late(facts)]


def _errors(facts: Sequence[Fact], more: str) -> list[CableFinding]:
    """Return the finding about corrupted and lost replies, if there is one."""
    answering = [fact for fact in facts if not fact.is_offline and fact.counts.asked]
    if not any(fact.is_bad for fact in answering):
        return []
    bad = _with_alike(answering)
    if any(_is_ambiguous(fact, bad) for fact in answering):
        return []
    first = answering.index(bad[0])
    numbers = f"{_numbers(bad)}{more}"
    if len(answering) == 1:
        text = phrase(EventCode.CABLE, "sole", starters=_named(bad), numbers=numbers)
        return [_finding("sole", bad, text)]
    if len(bad) == len(answering):
        return [_finding("all", (), phrase(EventCode.CABLE, "all", numbers=numbers))]
    if bad == answering[-1:]:
        before = _one(answering[-2])
        text = phrase(EventCode.CABLE, "last", starters=_named(bad), before=before, numbers=numbers)
        return [_finding("one", bad, text)]
    if len(bad) == 1:
        text = phrase(EventCode.CABLE, "one", starters=_named(bad), numbers=numbers)
        return [_finding("one", bad, text)]
    if bad == answering[first:]:
        before = _one(answering[first - 1])
        text = phrase(EventCode.CABLE, "from", first=_one(bad[0]), before=before, numbers=numbers)
        return [_finding("from", bad[:1], text)]
    if bad == answering[: len(bad)]:
        text = phrase(EventCode.CABLE, "up_to", last=_one(bad[-1]), starters=_named(bad), numbers=numbers)
        return [_finding("up_to", bad[-1:], text)]
    text = phrase(EventCode.CABLE, "some", starters=_named(bad), numbers=numbers)
    return [_finding("some", bad, text)]


def _with_alike(answering: Sequence[Fact]) -> list[Fact]:
    """Return the bad starters, with those of which little is known that look like them."""
    sure = [fact for fact in answering if fact.is_bad]
    common = sum(fact.counts.bad for fact in sure) / sum(fact.counts.asked for fact in sure)
    return [fact for fact in answering if fact.is_bad or (fact.is_undecided and fact.share >= ALIKE * common)]


def _is_ambiguous(fact: Fact, bad: Sequence[Fact]) -> bool:
    """Return whether more requests will show to which side a starter belongs."""
    if fact.is_bad or fact.counts.asked >= ENOUGH:
        return False
    sure = [each.share for each in bad if each.is_bad]
    return bounds(fact.counts.bad, fact.counts.asked)[1] >= ALIKE * min(sure)


def _silent_end(facts: Sequence[Fact]) -> list[CableFinding]:
    """Return the finding about several starters at the end that do not answer at all."""
    first = len(facts)
    while first and facts[first - 1].is_offline:
        first -= 1
    silent = facts[first:]
    if len(silent) < 2 or any(fact.is_offline for fact in facts[:first]):
        return []
    if first == 0:
        return [_finding("none", (), phrase(EventCode.CABLE, "none", count=len(silent)))]
    before, begin = _one(facts[first - 1]), _one(silent[0])
    text = phrase(EventCode.CABLE, "end", first=begin, before=before, starters=_named(silent))
    return [_finding("end", silent[:1], text)]


def _late(facts: Sequence[Fact]) -> list[CableFinding]:
    """Return the findings about replies that come too late, or nearly."""
    answering = [fact for fact in facts if not fact.is_offline and fact.counts.asked]
    late = [fact.late for fact in answering if fact.late is not None]
    if len(late) > 1 and len(late) == len(answering):
        asked = sum(each.asked for each in late)
        share = _percent(sum(each.late for each in late) / asked)
        return [_finding("late_all", (), phrase(EventCode.CABLE, "late_all", share=share, asked=asked))]
    found = []
    for fact in answering:
        limit_ms = fact.starter.response_time_s * 1000
        if fact.late is not None:
            asked, share = fact.late.asked, _percent(fact.late.late / fact.late.asked)
            text = phrase(
                EventCode.CABLE, "late", starter=_one(fact), limit_ms=limit_ms, share=share, asked=asked
            )
            found.append(_finding("late", [fact], text))
        elif fact.p99_s is not None:
            taken_ms = fact.p99_s * 1000
            text = phrase(EventCode.CABLE, "slow", starter=_one(fact), taken_ms=taken_ms, limit_ms=limit_ms)
            found.append(_finding("slow", [fact], text))
    return found


def _finding(kind: str, about: Sequence[Fact], text: str) -> CableFinding:
    return CableFinding(kind, tuple(fact.starter.name for fact in about), text)


def _numbers(facts: Sequence[Fact]) -> str:
    total = Counts()
    for fact in facts:
        total = total.plus(fact.counts)
    kinds = [phrase(EventCode.CABLE, "corrupted", count=total.corrupted)] if total.corrupted else []
    kinds += [phrase(EventCode.CABLE, "lost", count=total.lost)] if total.lost else []
    return phrase(
        EventCode.CABLE,
        "numbers",
        share=_percent(total.bad / total.asked),
        asked=total.asked,
        span=facts[0].span,
        kinds=", ".join(kinds),
    )


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if share < 0.1 else f"{100 * share:.0f} %"


def _one(fact: Fact) -> str:
    return phrase(EventCode.CABLE, "address", name=fact.starter.name, address=fact.starter.address)


def _named(facts: Sequence[Fact]) -> str:
    if len(facts) == 1:
        return _one(facts[0])
    names = [fact.starter.name for fact in facts]
    shown = ", ".join(names[:MOST_NAMED])
    if len(names) <= MOST_NAMED:
        return shown
    return phrase(EventCode.CABLE, "more", names=shown, count=len(names) - MOST_NAMED)
