"""A scheduler says in time what is due, whatever is done to it."""

from __future__ import annotations

import random
from unittest import mock

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Silent
from gateway.line.scheduler.requests import Job, Poll, Priority, Slot
from gateway.line.scheduler.scheduler import Scheduler
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister

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


def follow(operations: list[tuple[object, ...]]) -> None:
    """Do these operations with a scheduler."""
    scheduler = Scheduler((_poll(f"{unit}/0", 0.3 * unit) for unit in range(1, 4)), chance=random.Random(1))
    scheduler.polls.begin(0.0)
    keys = {f"{unit}/0" for unit in range(1, 4)}
    now_s = 0.0
    for operation in operations:
        now_s += 0.02
        match operation:
            case "slot", int(kind):
                if kind:
                    now_s = max(now_s, min(scheduler.next_due_s(), now_s + 1.0))
                slot = scheduler.pick(now_s)
                if slot is not None:
                    now_s += 0.03
                    scheduler.record(slot, OUTCOMES[kind], now_s)
            case "put back", float(for_s):
                slot = scheduler.pick(now_s)
                if slot is not None:
                    scheduler.put_back(slot, now_s + for_s)
            case "add", str(key), float(every_s) if key not in keys:
                scheduler.polls.add(_poll(key, every_s))
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


def _poll(key: str, every_s: float) -> Poll:
    return Poll(key, int(key[0]), ReadHoldingRegisters(0, 1), every_s, 0.01)


@settings(deadline=None, max_examples=200)
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
