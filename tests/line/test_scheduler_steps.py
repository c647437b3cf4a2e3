"""What a scheduler chooses, step by step, as tables.

Given are polls: `a/2@60w10` is poll a of unit 2 with a period of 60 s and a watchdog of 10 s (1, 1 s, none).

| step | at that second |
|---|---|
| `3 a`, `3 -`, `3 ?` | a is chosen, and answered; nothing is due; anything is chosen, and answered |
| `3 a silent`, `garbled`, `unsent`, `open` | its outcome |
| `3 a silent again`, `back`, `lost` | it is to be sent again; its unit is back, is lost |
| `3 a gone` | it is chosen and answered, and removed meanwhile |
| `3 +x:stop/2` | job x of unit 2 comes; `~`: a read |
| `3 every a 5`, `3 hurry a`, `3 hurry` (all), `3 add b`, `remove a`, `forget 1` | |
| `3 begin`, `watchdog 1 8`, `3 expect 1 5`, `3 late 1` | |
| `due 3`, `state 1 silent`, `withdraw x`, `clear x y` | what is so |
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.line.rtu.transaction import Garbled, Outcome, Silent
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from tests.line.ideal_line import ANSWERED, GARBLED, READ, WRITE, begun, job
from tests.line.line_rig import poll

OUTCOMES: dict[str, Outcome] = {
    "silent": Silent(),
    "garbled": GARBLED,
    "unsent": Garbled("noise", b"", is_sent=False),
}


def poll_of(words: str) -> Poll:
    words, _, limit = words.partition("w")
    words, _, every = words.partition("@")
    key, _, unit = words.partition("/")
    made = poll(key, int(unit or 1), float(every or 1.0))
    return replace(made, deadline_s=float(limit)) if limit else made


class Steps:
    """A scheduler that is led through steps."""

    def __init__(self, given: str) -> None:
        self.scheduler = begun(*map(poll_of, given.split()))
        self.jobs: dict[str, Job] = {}

    def name(self, slot: Slot | None) -> str:
        if slot is None:
            return "-"
        names = [name for name, each in self.jobs.items() if each in slot.jobs]
        return "+".join(names) if slot.poll is None else slot.poll.key

    def do(self, step: str) -> None:
        what, *rest = step.split()
        polls = self.scheduler.polls
        match what, rest:
            case "due", [at]:
                assert self.scheduler.next_due_s() == pytest.approx(float(at))
            case "state", [unit, state]:
                assert polls.unit(int(unit)).state.value == state
            case "withdraw", [name]:
                assert self.scheduler.jobs.withdraw(self.jobs[name])
                assert not self.scheduler.jobs.withdraw(self.jobs[name])
            case "clear", _:
                assert self.scheduler.jobs.clear() == tuple(self.jobs[name] for name in rest)
            case "remove", [key]:
                polls.remove(key)
            case "watchdog", [unit, limit]:
                polls.set_deadline(int(unit), float(limit))
            case at, ["begin"]:
                polls.begin(float(at))
            case at, ["every", key, every]:
                polls.set_every(key, float(every), float(at))
            case at, ["hurry", key]:
                polls.expedite(key, float(at))
            case at, ["hurry"]:
                polls.expedite_all(float(at))
            case "forget", [unit]:
                polls.forget(int(unit))
            case at, ["add", words]:
                polls.add(poll_of(words), float(at))
            case _, ["expect", unit, until]:
                polls.unit(int(unit)).expect_silence(float(until))
            case at, ["late", unit]:
                polls.note_late(int(unit), float(at))
            case at, [words] if words.startswith("+"):
                name, _, lane = words[1:].partition(":")
                request = READ if lane.endswith("~") else WRITE
                lane, _, unit = lane.rstrip("~").partition("/")
                self.jobs[name] = job(Priority[lane.upper()], int(unit or 1), request)
                self.scheduler.jobs.submit(self.jobs[name], float(at))
            case _:
                self.choose(float(what), *rest)

    def choose(self, now_s: float, expected: str, *said: str) -> None:
        slot = self.scheduler.pick(now_s)
        assert expected in ("?", self.name(slot))
        if "gone" in said:
            self.scheduler.polls.remove(expected)
        if slot is not None:
            outcome = next((OUTCOMES[word] for word in said if word in OUTCOMES), ANSWERED)
            verdict = self.scheduler.record(slot, outcome, now_s, is_open="open" in said)
            if "gone" not in said:
                assert verdict.is_final is ("again" not in said)
            if "back" in said or "lost" in said:
                assert verdict.is_answering is ("back" in said)


POLLS = {
    "an empty scheduler has nothing to do": ("", "0 -, due inf"),
    "polls come by their due time": ("a b@0.4", "0 a, 0 b, 0.39 -, 0.4 b, 0.8 b, 1 a, 1.21 b"),
    "a poll keeps its rhythm though each slot is a little late": (
        "a",
        "0.3 a, 0.999 -, 1.3 a, 1.999 -, 2.3 a, 2.999 -, due 3",
    ),
    "polls without a period alternate": ("a@0 b@0 c@0", "0 a, 0 b, 0 c, 0 a, 0 b, 0 c"),
    "a line that is too slow stretches evenly and never catches up": (
        "a b c d",
        ", ".join(f"{step / 2} {'abcd'[step % 4]}" for step in range(40)),
    ),
    "a shorter period takes effect at once and a longer one after the next slot": (
        "a@10",
        "0 a, 1 every a 0.2, due 1.2, 1.2 a, 1.2 every a 10, due 1.4, 1.4 a, due 11.4",
    ),
    "an expedited poll is due now": ("a@10", "0 a, 3 hurry a, due 3, 3 a, due 13"),
    "a poll may get and lose its period": (
        "a@0 b@0",
        "0 a, 0 every a 5, 0 b, 0 a, 0 b, 0 b, 1 every a 0, 1 b, 1 a",
    ),
    "a garbled poll is repeated once, at once, and counts when that was no use": (
        "a b",
        "0 a garbled again, state 1 new, 0.1 a garbled, state 1 suspect, 0.2 b",
    ),
    "a poll that is open is asked again at once, as often as needed": (
        "a b",
        "0 a open again, 0.1 a open again, 0.2 a open again, state 1 answering,0.3 a, 0.3 b, 0.9 -, 1 a, 1 b",
    ),
    "an open poll that is removed is not asked once more": ("a b", "0 a, 0 b open again, remove b, 1 a, 1 -"),
    "what was not sent for noise is not repeated at once": ("a", "0 a unsent, 0 -"),
    "a poll that is removed while it is under way stays removed": ("a", "0 a gone garbled, due inf"),
    "a poll that is removed before its repetition is not repeated": (
        "a b",
        "0 a garbled again, remove a, 0.1 b",
    ),
    "what was expedited twice comes once": ("a@10 b@10", "0 a, 0 b, 3 hurry b, 3 hurry b, 3 b, 3 -"),
}

JOBS = {
    "jobs come before polls, by their priority": (
        "a@0",
        "0 a, 0 +O:patrol, 0 +I:identity, 0 +W:watchdog, 0 +P:parameters, 0 +R:read_back, 0 +C:command,"
        "0 +F:follow_up, 0 +S:stop, due -inf, 0 S, 0 F, 0 C, 0 R, 0 P, 0 W, 0 I, 0 O, 0 a",
    ),
    "every unit's first poll waits for stops, commands and questions for watchdogs only": (
        "a b/2 c",
        "0 +S:stop/99, 0 +C:command/99, 0 +P:parameters/99, 0 +W:watchdog/99, 0 +I:identity/99,"
        "0 +O:patrol/99, 0 S, 0 C, 0 P, 0 W, 0 a, 0 b, 0 I, 0 O, 0 c",
    ),
    "every fourth job is the oldest that waits": (
        "",
        "0 +P:parameters, 1 +A:command, 1 +B:command, 1 +C:command, 1 +D:command, 1 A, 1 B, 1 C, 1 P, 1 D",
    ),
    "the gateway's own questions wait for all commands, however old they are": (
        "a",
        "0 a, 0 +I:identity, 0 +W:watchdog, 0.5 +A:command, 0.5 +B:parameters, 0.5 +C:command,"
        "0.5 +D:read_back, 0.5 +E:parameters, 0.5 A, 0.5 C, 0.5 D, 0.5 B, 0.5 E, 0.5 W, 0.5 I",
    ),
    "jobs go on while no poll is due": (
        "a@10",
        "0 a, " + ", ".join(f"0 +j{n}:command" for n in range(40)) + ", 1 ?" * 40 + ", 1 -",
    ),
    "stops overtake an overdue poll, however many": (
        "a@0",
        ", ".join(f"0 +s{n}:stop" for n in range(10)) + "".join(f", 0 s{n}" for n in range(10)) + ", 0 a",
    ),
    "a waiting job can be withdrawn": ("", "0 +x:command, 0 +y:command, withdraw y, 0 x, 0 -"),
    "all waiting jobs can be taken out": ("", "0 +x:read_back, 0 +s:stop, clear s x, clear"),
    "a job that is open is sent again before the others of its priority": (
        "",
        "0 +r:read_back~, 0 +o:read_back~, 0 r open again, 0 r open again, 0 r, 0 o",
    ),
    "a garbled read is repeated once before the others of its priority": (
        "",
        "0 +r:read_back~, 0 +o:read_back~, 0 r garbled again, 0 r garbled, 0 o",
    ),
    "a garbled write is never repeated": ("", "0 +w:command, 0 w garbled, 0 -"),
    "a stop that has waited for long is sent for later ones of its unit only": (
        "",
        "0 +x:stop, 0.2 +y:stop, 0.2 +z:stop/2, 0.2 x+y, 0.2 z, 0.2 -",
    ),
    "a stop that has only just come is not shared": ("", "0 +x:stop, 0 +y:stop, 0 x, 0 y"),
    "of a shared stop each job can be withdrawn alone": (
        "",
        "0 +x:stop, 0.2 +y:stop, 0.2 +z:stop, withdraw x, withdraw z, clear y",
    ),
}

SILENT_UNITS = {
    "after an outage every poll is asked once": ("a b", "0 a, 0 b, 100 begin, 100 a, 100 b, 100 -"),
    "after an outage each unit's state is reported once more": ("a", "0 a back, 100 begin, 100 a back"),
    "a unit is lost after four misses": (
        "a",
        "0 a back, 1 a silent, 2 a silent, 4 a silent, 8 a silent lost, 20 a back",
    ),
    "a silent unit is asked by its first poll only, and in full once it answers": (
        "a b c/2",
        "0 a silent, 0 c, 0 b silent, state 1 silent, 0.9 -, 1 c, 1 a, 1 b",
    ),
    "an open answer to a probe brings its unit back, and the probe is asked once more, before all others": (
        "a b c/2 d/3",
        "0 a silent, 0 c, 0 d, 0 b silent, state 1 silent, 1 c, 1 a open again back, 1 a, 1 d, 1 b, 1 -",
    ),
    "a late reply of a silent unit ends its back-off": (
        "a",
        "0 a back, 1 a silent, 2 a silent, 4 a silent, due 8, 5 late 1, due 6, 6 a",
    ),
    "an answered job brings a silent unit back too": (
        "a b",
        "0 a silent, 0 b silent, 0.1 +w:command, 0.1 w back, 0.1 a, 0.1 b",
    ),
    "jobs that a silent unit does not answer leave its back-off alone": (
        "a",
        "0 a silent, 1 a silent, due 2, 1 +w:command, 1 w silent, due 2",
    ),
    "a silent unit is asked ever less often, up to the ceiling": (
        "a",
        "0 a silent, 1 a silent, 2 a silent, 4 a silent, 8 a silent, 16 a silent, 32 a silent, due 48",
    ),
    "a poll with a longer period than the ceiling keeps it": ("a@60", "0 a silent, 60 a silent, due 120"),
    "a unit whose replies are all corrupted is asked in its own rhythm": (
        "a",
        "0 a garbled again, 0 a garbled, 1 a garbled again, 1 a garbled, 2 a garbled again, 2 a garbled,"
        "due 3",
    ),
    "when no unit could be received all are asked at once": (
        "a b/2",
        "0 a silent, 0 b silent, 1 ? silent, 1 ? silent, 2 ? silent, 2 ? silent, 2.5 -,"
        "2.5 hurry, 2.5 a, 2.5 b",
    ),
    "another in a forgotten unit's place is asked at once and is news": (
        "a",
        "0 a silent, 1 a silent, remove a, forget 1, 2 add b, state 1 new, 2 b back",
    ),
    "an expected silence ends, and then misses count": (
        "a b",
        "0 expect 1 2, 0 a silent, 1 ? silent, 2 ? silent, 3 ? silent, state 1 silent",
    ),
    "a unit without polls can go silent, and its first poll is its probe": (
        "",
        "0 +x:command/9, 0 x silent, 1 +y:command/9, 1 y silent, state 9 silent,"
        "3 add p/9, 3 add h/9, 3 p silent, 3 -",
    ),
    "a silent unit's back-off outlasts a change of period": (
        "a",
        "0 a silent, 1 a silent, 2 a silent, 4 a silent, due 8, 4 every a 0.2, due 8",
    ),
    "expediting any poll of a silent unit expedites its probe": (
        "a b",
        "0 a silent, 0 b silent, 0.5 hurry b, 0.5 a",
    ),
    "when the probe is removed the next poll takes its place": (
        "a b c",
        "0 a silent, 0 b silent, remove c, remove a, due 1, 1 b, remove b, due inf",
    ),
    "also while it is asked": ("a b", "0 a silent, 0 b silent, 1 a gone silent, 1 b"),
    "after an outage a silent unit is still asked by its probe only": (
        "a b",
        "0 a silent, 0 b silent, 100 begin, 100 a silent, 100 -",
    ),
    "after an outage the first poll of each unit comes before reads of our own": (
        "a b c/2",
        "0 +r:patrol, 0 a, 0 c, 0 r",
    ),
    "a unit that missed once is not asked again before one that answers": (
        "a b c/2",
        "0 a silent, 0.1 c, 0.2 b",
    ),
}

WATCHDOGS = {
    "a unit is asked ahead of its poll when half of its watchdog's time has passed": (
        "a@60w10",
        "0 a, due 5, 4.9 -, 5 a",
    ),
    "any request that a unit answered counts": ("a@60w10", "0 a, 4 +r:read_back, 4 r, 8.9 -, 9 a"),
    "a watchdog goes before commands and after stops": (
        "a@60w10",
        "0 a, 5 +C:command/99, 5 +S:stop/99, 5 S, 5 a, 5 C",
    ),
    "a line begins with the shortest watchdogs": ("a@60w9 b/2@60 c/3@60w3", "0 c, 0 a, 0 b"),
    "the earliest deadline comes first": ("a@60w20 b/2@60w10", "0 ?, 0 ?, 11 b, 11 a, 11 -"),
    "starters that are added later go before no watchdog that is running": (
        "a@60w10",
        "0 a, 5 add b/2@60w1, 5 add c/3@60w1, 5 a, 5 b, 5 c",
    ),
    "the repetition of a corrupted read waits for a watchdog that is due": (
        "a b/2@60w10",
        "0 ?, 0 ?, 4.99 a garbled again, 5 b, 5 a garbled",
    ),
    "a deadline can be set, changed and taken away later": (
        "a@60",
        "watchdog 1 8, 0 a, due 4, watchdog 1 30, due 15, watchdog 1 0, due 60",
    ),
    "a unit that did not answer is asked again after another quarter": (
        "a@60w8",
        "0 a, 4 a silent, 5.9 -, 6 a",
    ),
    "no line time is reserved for a unit that has gone silent until it answers": (
        "a@1w2",
        "0 a, 1 a silent, 2 a silent, due 3, 3 a, due 4",
    ),
    "a watchdog that becomes known has counted since its unit was reached last": (
        "a@60",
        "0 a, watchdog 1 10, due 5, 5 a",
    ),
    "a forgotten unit's watchdog asks for no request": (
        "a@60w4",
        "0 a, remove a, forget 1, due inf, 1000 -",
    ),
    "a silent unit with a watchdog is asked often enough for it, as it may receive": (
        "a@1w10",
        "0 a silent, 1 a silent, 2 a silent, 3.25 a silent, due 4.5",
    ),
}

TABLES = {**POLLS, **JOBS, **SILENT_UNITS, **WATCHDOGS}


@pytest.mark.parametrize("name", TABLES)
def test_a_scheduler_does(name: str) -> None:
    given, steps = TABLES[name]
    here = Steps(given)

    for step in steps.split(","):
        here.do(step)
