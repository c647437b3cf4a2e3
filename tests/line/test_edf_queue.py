from __future__ import annotations

import random
from unittest import mock

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Silent
from gateway.line.scheduler.line_time import EdfQueue, Queued
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from tests.line.list_queue import ListQueue

TIMES_S = st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0])


@settings(deadline=None)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("put"), st.integers(0, 5), TIMES_S, TIMES_S),
            st.tuples(st.just("drop"), st.integers(0, 5)),
            st.tuples(st.just("look"), TIMES_S),
        ),
        max_size=300,
    )
)
def test_it_does_what_a_plain_list_does(steps: list[tuple[object, ...]]) -> None:
    queue, plain = EdfQueue[Queued](), ListQueue[Queued]()
    pairs = [(Queued(), Queued()) for _ in range(6)]
    one_of = {id(one): at for at, pair in enumerate(pairs) for one in pair}
    now_s = 0.0
    for step in steps:
        match step:
            case "put", int(at), float(release_s), float(deadline_s):
                for thing, each in zip(pairs[at], (queue, plain), strict=True):
                    each.put(thing, release_s, deadline_s)
            case "drop", int(at):
                for thing in pairs[at]:
                    thing.leave()
            case _, float(at_s):
                now_s = max(now_s, at_s)
                found = [each.first(now_s) for each in (queue, plain)]
                seen = [None if each is None else one_of[id(each)] for each in found]
                assert seen[0] == seen[1]
                assert queue.next_s() == plain.next_s()


OUTCOMES: tuple[Outcome, ...] = (
    Answered((1,), at_s=0.0, response_time_s=0.005),
    Silent(),
    Garbled("bad CRC", b"\x01"),
)
KEYS = st.sampled_from([f"{unit}/{block}" for unit in range(1, 5) for block in range(2)])
OPERATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("slot"), st.sampled_from([0, 0, 0, 1, 1, 2])),
        st.tuples(st.just("put back"), st.sampled_from([0.0, 0.1])),
        st.tuples(st.just("add"), KEYS, st.sampled_from([0.0, 0.1, 1.0])),
        st.tuples(st.just("remove"), KEYS),
        st.tuples(st.just("set every"), KEYS, st.sampled_from([0.0, 0.2, 5.0])),
        st.tuples(st.just("expedite"), KEYS),
        st.tuples(st.just("deadline"), st.integers(1, 4), st.sampled_from([None, 0.5, 2.0])),
        st.tuples(st.just("job"), st.sampled_from(Priority)),
        st.tuples(
            st.just("begin"),
        ),
    ),
    max_size=120,
)


def follow(operations: list[tuple[object, ...]]) -> list[object]:
    """Return everything that a scheduler says while these operations are done."""
    scheduler = Scheduler((_poll(f"{unit}/0", 0.3 * unit) for unit in range(1, 4)), chance=random.Random(1))
    scheduler.polls.begin(0.0)
    keys = {f"{unit}/0" for unit in range(1, 4)}
    now_s, said = 0.0, list[object]()
    for operation in operations:
        now_s += 0.02
        match operation:
            case "slot", int(kind):
                if kind:
                    now_s = max(now_s, min(scheduler.next_due_s(), now_s + 1.0))
                slot = scheduler.pick(now_s)
                said.append((now_s, _name(slot)))
                if slot is not None:
                    now_s += 0.03
                    said.append(scheduler.record(slot, OUTCOMES[kind], now_s))
            case "put back", float(for_s):
                slot = scheduler.pick(now_s)
                if slot is not None:
                    scheduler.put_back(slot, now_s + for_s)
            case "add", str(key), float(every_s) if key not in keys:
                scheduler.polls.add(_poll(key, every_s), now_s)
                keys.add(key)
            case "remove", str(key) if key in keys:
                scheduler.polls.remove(key)
                keys.discard(key)
            case "set every", str(key), float(every_s) if key in keys:
                scheduler.polls.set_every(key, every_s, now_s)
            case "expedite", str(key) if key in keys:
                scheduler.polls.expedite(key, now_s)
            case "deadline", int(unit), float() | None as limit_s:
                scheduler.polls.set_deadline(unit, limit_s)
            case "job", Priority() as lane:
                scheduler.jobs.submit(Job(1, WriteRegister(1, 2), 0.01, lane, lambda outcome: None), now_s)
            case ("begin",):
                scheduler.polls.begin(now_s)
        said.append((scheduler.next_due_s(), scheduler.polls.stretch, scheduler.polls.asked()))
    return said


def _poll(key: str, every_s: float) -> Poll:
    return Poll(key, int(key[0]), ReadHoldingRegisters(0, 1), every_s, 0.01)


def _name(slot: Slot | None) -> object:
    if slot is None:
        return None
    return slot.poll.key if slot.poll is not None else slot.lane


@settings(deadline=None, max_examples=100)
@given(OPERATIONS)
def test_a_scheduler_is_never_late_to_say_what_is_due(operations: list[tuple[object, ...]]) -> None:
    for now_s, due_before_s, slot, due_after_s in looks(operations):
        if due_before_s > now_s:
            assert slot is None
        if slot is None:
            assert due_after_s > now_s


def looks(operations: list[tuple[object, ...]]) -> list[tuple[float, float, object, float]]:
    """Return for each choice: when, what was due when beforehand, what was chosen, what is due afterwards."""
    seen = []
    pick = Scheduler.pick

    def look(scheduler: Scheduler, now_s: float) -> Slot | None:
        due_before_s = scheduler.next_due_s()
        slot = pick(scheduler, now_s)
        seen.append((now_s, due_before_s, slot, scheduler.next_due_s()))
        return slot

    with mock.patch.object(Scheduler, "pick", look):
        follow(operations)
    return seen
