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
        text = f"errors of {_named(bad)}, the only one that answers: its cable, termination, or the starter"
        return [_finding("sole", bad, text, numbers)]
    if len(bad) == len(answering):
        text = "errors of all starters: termination, bias or noise, or the cable before the first one"
        return [_finding("all", bad, text, numbers)]
    if len(bad) == 1:
        end = f", or the cable after {_one(answering[-2])}" if bad[0] is answering[-1] else ""
        text = f"errors only of {_named(bad)}: its connector, its address or the starter itself{end}"
        return [_finding("one", bad, text, numbers)]
    if bad == answering[first:]:
        before = _one(answering[first - 1])
        text = f"errors only from {_one(bad[0])} on: look at the cable after {before}"
        return [_finding("from", bad[:1], text, numbers)]
    if bad == answering[: len(bad)]:
        text = f"errors only up to {_one(bad[-1])}, none after it: look at the connectors of {_named(bad)}"
        return [_finding("up_to", bad[-1:], text, numbers)]
    text = f"errors of {_named(bad)}, others between them are good: their connectors, or noise there"
    return [_finding("some", bad, text, numbers)]


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
        text = (
            "no starter answers: no supply, the adapter, the cable before the first one, or wires exchanged"
        )
        return [CableFinding("none", (), f"{text} ({len(silent)} starters)")]
    before, begin = _one(facts[first - 1]), _one(silent[0])
    text = f"no replies from {begin} on: look at the cable after {before}, or at their supply"
    return [CableFinding("end", (silent[0].starter.name,), f"{text} ({_named(silent)})")]


def _late(facts: Sequence[Fact]) -> list[CableFinding]:
    """Return the findings about replies that come too late, or nearly."""
    answering = [fact for fact in facts if not fact.is_offline and fact.counts.asked]
    late = [fact.late for fact in answering if fact.late is not None]
    if len(late) > 1 and len(late) == len(answering):
        text = "late replies of all starters: the adapter or a serial server delays them"
        return [CableFinding("late_all", (), f"{text} ({_late_numbers(late)})")]
    found = []
    for fact in answering:
        limit = f"{fact.starter.response_time_s * 1000:.0f} ms"
        if fact.late is not None:
            text = f"late replies of {_one(fact)}: its response time, longer than {limit}"
            text = f"{text} ({_late_numbers([fact.late])})"
            found.append(CableFinding("late", (fact.starter.name,), text))
        elif fact.p99_s is not None:
            text = f"slow answers of {_one(fact)}: its response time ({fact.p99_s * 1000:.0f} ms of {limit})"
            found.append(CableFinding("slow", (fact.starter.name,), text))
    return found


def _finding(kind: str, bad: Sequence[Fact], text: str, numbers: str) -> CableFinding:
    names = () if kind == "all" else tuple(fact.starter.name for fact in bad)
    return CableFinding(kind, names, f"{text} ({numbers})")


def _numbers(facts: Sequence[Fact]) -> str:
    total = Counts()
    for fact in facts:
        total = total.plus(fact.counts)
    parts = [f"{total.corrupted} corrupted"] if total.corrupted else []
    parts += [f"{total.lost} lost"] if total.lost else []
    share = total.bad / total.asked
    return f"{_percent(share)} of {total.asked} replies {facts[0].span}: {', '.join(parts)}"


def _late_numbers(counts: Sequence[Counts]) -> str:
    asked, late = sum(each.asked for each in counts), sum(each.late for each in counts)
    return f"{_percent(late / asked)} of {asked} replies"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if share < 0.1 else f"{100 * share:.0f} %"


def _one(fact: Fact) -> str:
    return f"{fact.starter.name} (address {fact.starter.address})"


def _named(facts: Sequence[Fact]) -> str:
    if len(facts) == 1:
        return _one(facts[0])
    names = [fact.starter.name for fact in facts]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f"{', '.join(names[:MOST_NAMED])}{more}"
