from __future__ import annotations

import random
from unittest import mock

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Silent
from gateway.line.scheduler import polls, watchdogs
from gateway.line.scheduler.edf_queue import EdfQueue, Queued
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from tests.line.list_agenda import ListAgenda

TIMES_S = st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0])


def test_the_earliest_deadline_of_what_is_released_comes_first() -> None:
    agenda: EdfQueue[Queued] = EdfQueue()
    late, soon, not_yet = (
        Queued(release_s=0.0, deadline_s=9.0),
        Queued(release_s=1.0, deadline_s=5.0),
        Queued(release_s=2.0, deadline_s=3.0),
    )
    for thing in (late, soon, not_yet):
        agenda.put(thing)

    assert agenda.first(0.0) is late
    assert agenda.first(1.0) is soon
    assert agenda.next_s() == 1.0
    assert agenda.first(2.0) is not_yet


def test_of_equal_deadlines_what_was_put_first_comes_first() -> None:
    agenda: EdfQueue[Queued] = EdfQueue()
    things = [Queued(release_s=0.0, deadline_s=1.0) for _ in range(3)]
    for thing in things:
        agenda.put(thing)

    agenda.put(things[0])

    assert agenda.first(0.0) is things[1]


def test_what_is_put_on_another_agenda_leaves_the_first() -> None:
    one: EdfQueue[Queued] = EdfQueue()
    other: EdfQueue[Queued] = EdfQueue()
    thing = Queued(release_s=0.0, deadline_s=1.0)
    one.put(thing)

    other.put(thing)

    assert one.first(0.0) is None
    assert other.first(0.0) is thing


def test_changing_ones_mind_often_costs_no_memory() -> None:
    agenda: EdfQueue[Queued] = EdfQueue()
    thing = Queued(release_s=5.0, deadline_s=6.0)

    for _ in range(10_000):
        agenda.put(thing)

    assert len(agenda._waiting) < 200
    assert agenda.first(5.0) is thing


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
    agenda, plain = EdfQueue[Queued](), ListAgenda[Queued]()
    pairs = [(Queued(), Queued()) for _ in range(6)]
    one_of = {id(one): at for at, pair in enumerate(pairs) for one in pair}
    now_s = 0.0
    for step in steps:
        match step:
            case "put", int(at), float(release_s), float(deadline_s):
                for thing, kept in zip(pairs[at], (agenda, plain), strict=True):
                    thing.release_s, thing.deadline_s = release_s, deadline_s
                    kept.put(thing)
            case "drop", int(at):
                for thing in pairs[at]:
                    thing.leave()
            case _, float(at_s):
                now_s = max(now_s, at_s)
                found = [kept.first(now_s) for kept in (agenda, plain)]
                seen = [None if each is None else one_of[id(each)] for each in found]
                assert seen[0] == seen[1]
                assert agenda.next_s() == plain.next_s()


OUTCOMES: tuple[Outcome, ...] = (
    Answered((1,), at_s=0.0, response_time_s=0.005),
    Silent(),
    Garbled("bad CRC", b"\x01"),
)
KEYS = st.sampled_from([f"{unit}/{block}" for unit in range(1, 5) for block in range(2)])
OPERATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("turn"), st.sampled_from([0, 0, 0, 1, 1, 2])),
        st.tuples(st.just("put back"), st.sampled_from([0.0, 0.1])),
        st.tuples(st.just("add"), KEYS, st.sampled_from([0.0, 0.1, 1.0])),
        st.tuples(st.just("remove"), KEYS),
        st.tuples(st.just("set every"), KEYS, st.sampled_from([0.0, 0.2, 5.0])),
        st.tuples(st.just("hasten"), KEYS),
        st.tuples(st.just("deadline"), st.integers(1, 4), st.sampled_from([None, 0.5, 2.0])),
        st.tuples(st.just("job"), st.sampled_from(Priority)),
        st.tuples(
            st.just("begin"),
        ),
    ),
    max_size=120,
)


def follow(operations: list[tuple[object, ...]]) -> list[object]:
    """Return everything that a plan says while these operations are done."""
    plan = Scheduler((_poll(f"{unit}/0", 0.3 * unit) for unit in range(1, 4)), chance=random.Random(1))
    plan.begin(0.0)
    keys = {f"{unit}/0" for unit in range(1, 4)}
    now_s, said = 0.0, list[object]()
    for operation in operations:
        now_s += 0.02
        match operation:
            case "turn", int(kind):
                if kind:
                    now_s = max(now_s, min(plan.next_due_s(), now_s + 1.0))
                turn = plan.pick(now_s)
                said.append((now_s, _name(turn)))
                if turn is not None:
                    now_s += 0.03
                    said.append(plan.record(turn, OUTCOMES[kind], now_s))
            case "put back", float(for_s):
                turn = plan.pick(now_s)
                if turn is not None:
                    plan.put_back(turn, now_s + for_s)
            case "add", str(key), float(every_s) if key not in keys:
                plan.polls.add(_poll(key, every_s), now_s)
                keys.add(key)
            case "remove", str(key) if key in keys:
                plan.polls.remove(key)
                keys.discard(key)
            case "set every", str(key), float(every_s) if key in keys:
                plan.polls.set_every(key, every_s, now_s)
            case "hasten", str(key) if key in keys:
                plan.polls.expedite(key, now_s)
            case "deadline", int(unit), float() | None as limit_s:
                plan.polls.set_deadline(unit, limit_s)
            case "job", Priority() as lane:
                plan.jobs.submit(Job(1, WriteRegister(1, 2), 0.01, lane, lambda outcome: None), now_s)
            case ("begin",):
                plan.begin(now_s)
        said.append((plan.next_due_s(), plan.polls.stretch, plan.polls.asked()))
    return said


def _poll(key: str, every_s: float) -> Poll:
    return Poll(key, int(key[0]), ReadHoldingRegisters(0, 1), every_s, 0.01)


def _name(turn: Slot | None) -> object:
    if turn is None:
        return None
    return turn.poll.key if turn.poll is not None else turn.job and turn.job.lane


@settings(deadline=None, max_examples=200)
@given(OPERATIONS)
def test_a_plan_does_the_same_with_plain_lists(operations: list[tuple[object, ...]]) -> None:
    with (
        mock.patch.object(polls, "EdfQueue", ListAgenda),
        mock.patch.object(watchdogs, "EdfQueue", ListAgenda),
    ):
        expected = follow(operations)

    assert follow(operations) == expected


@settings(deadline=None, max_examples=200)
@given(OPERATIONS)
def test_a_plan_is_never_late_to_say_what_is_due(operations: list[tuple[object, ...]]) -> None:
    for now_s, due_before_s, turn, due_after_s in looks(operations):
        if due_before_s > now_s:
            assert turn is None
        if turn is None:
            assert due_after_s > now_s


def looks(operations: list[tuple[object, ...]]) -> list[tuple[float, float, object, float]]:
    """Return for each choice: when, what was due when beforehand, what was chosen, what is due afterwards."""
    seen = []
    pick = Scheduler.pick

    def look(plan: Scheduler, now_s: float) -> Slot | None:
        due_before_s = plan.next_due_s()
        turn = pick(plan, now_s)
        seen.append((now_s, due_before_s, turn, plan.next_due_s()))
        return turn

    with mock.patch.object(Scheduler, "pick", look):
        follow(operations)
    return seen
