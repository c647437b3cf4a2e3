from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace
from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.health import UnitState
from gateway.line.job import Job, Lane, Poll
from gateway.line.outcome import Answered, Garbled, Outcome, Silent
from gateway.line.plan import JOBS_IN_ROW, Plan, Turn, Verdict
from gateway.line.stretch import FREE_ROOM
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.writes import WriteRegister
from tests.line.fakes import poll

READ = ReadHoldingRegisters(0, 1)
WRITE = WriteRegister(1, 2)
ANSWERED = Answered((1,), at_s=0.0, response_time_s=0.005)
GARBLED = Garbled("bad CRC", b"\x01")


def job(lane: Lane = Lane.COMMAND, unit: int = 1, request: Request = WRITE) -> Job:
    return Job(unit, request, 0.01, lane, lambda outcome: None)


def key_of(turn: Turn | None) -> str | None:
    return None if turn is None or turn.poll is None else turn.poll.key


def take(plan: Plan, now_s: float, outcome: Outcome = ANSWERED) -> Turn | None:
    turn = plan.pick(now_s)
    if turn is not None:
        plan.record(turn, outcome, now_s)
    return turn


def ask_times(plan: Plan, outcomes: list[Outcome]) -> list[float]:
    """Return when a unit is asked when it always answers so, on an otherwise idle line."""
    times_s = []
    for outcome in outcomes:
        now_s = max(plan.next_due_s(), 0.0)
        assert take(plan, now_s, outcome) is not None
        times_s.append(now_s)
    return times_s


def gaps(times_s: list[float]) -> list[float]:
    return [later - earlier for earlier, later in itertools.pairwise(times_s)]


def begun(*polls: Poll, jitter: float = 0.0, seed: int = 0) -> Plan:
    plan = Plan(polls, jitter=jitter, seed=seed)
    plan.begin(0.0)
    return plan


def test_an_empty_plan_has_nothing_to_do() -> None:
    plan = begun()

    assert plan.pick(0.0) is None
    assert plan.next_due_s() == inf


def test_polls_come_by_their_due_time() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=0.4))

    seen = [(at_s, key_of(take(plan, at_s))) for at_s in (0.0, 0.0, 0.39, 0.4, 0.8, 1.0, 1.21)]

    assert [key for _, key in seen] == ["a", "b", None, "b", "b", "a", "b"]


def test_a_poll_keeps_its_rhythm_though_each_turn_is_a_little_late() -> None:
    plan = begun(poll("a", every_s=1.0))

    for second in range(5):
        assert plan.pick(second - 1e-6) is None
        take(plan, second + 0.3)

    assert plan.next_due_s() == 5.0


def test_polls_without_a_period_take_turns() -> None:
    plan = begun(poll("a", every_s=0.0), poll("b", every_s=0.0), poll("c", every_s=0.0))

    assert [key_of(take(plan, 0.0)) for _ in range(6)] == ["a", "b", "c", "a", "b", "c"]


def test_a_line_that_is_too_slow_stretches_evenly_and_never_catches_up() -> None:
    plan = begun(*(poll(key, every_s=1.0) for key in "abcd"))

    keys = [key_of(take(plan, 0.5 * step)) for step in range(40)]

    assert keys == list("abcd") * 10


def test_after_an_outage_every_poll_is_asked_once() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=1.0))
    take(plan, 0.0)
    take(plan, 0.0)

    plan.begin(100.0)

    assert [key_of(take(plan, 100.0)) for _ in range(3)] == ["a", "b", None]


def test_after_an_outage_each_units_state_is_told_anew() -> None:
    plan = begun(poll("a"))
    take(plan, 0.0)

    plan.begin(100.0)

    turn = plan.pick(100.0)
    assert turn is not None
    assert plan.record(turn, ANSWERED, 100.0).is_answering is True


def test_jobs_come_before_polls_and_lanes_in_their_order() -> None:
    plan = begun(poll("a", every_s=0.0))
    take(plan, 0.0)
    jobs = {lane: job(lane) for lane in (Lane.PARAMETERS, Lane.READ_BACK, Lane.STOP, Lane.COMMAND)}
    for waiting in jobs.values():
        plan.submit(waiting, 0.0)

    assert plan.next_due_s() == -inf
    turns = [take(plan, 0.0) for _ in range(5)]

    assert [turn.job for turn in turns if turn] == [jobs[lane] for lane in sorted(Lane)] + [None]


def test_every_units_first_poll_waits_for_stops_and_commands_only() -> None:
    plan = begun(poll("a"), poll("b", unit=2), poll("c"))
    jobs = {lane: job(lane) for lane in Lane}
    for waiting in jobs.values():
        plan.submit(waiting, 0.0)

    turns = [take(plan, 0.0) for _ in range(7)]

    assert [key_of(turn) or (turn and turn.job) for turn in turns] == [
        *(jobs[Lane.STOP], jobs[Lane.COMMAND], "a", "b"),
        *(jobs[Lane.READ_BACK], jobs[Lane.PARAMETERS], "c"),
    ]


def test_an_overdue_poll_waits_for_a_few_jobs_only() -> None:
    plan = begun(poll("a", every_s=0.0))
    for _ in range(10):
        plan.submit(job(), 0.0)

    keys = [key_of(take(plan, 0.0)) for _ in range(12)]

    assert [at for at, key in enumerate(keys) if key == "a"] == [JOBS_IN_ROW, 2 * JOBS_IN_ROW + 1]


def test_jobs_go_on_while_no_poll_is_due() -> None:
    plan = begun(poll("a", every_s=10.0))
    take(plan, 0.0)
    for _ in range(2 * JOBS_IN_ROW):
        plan.submit(job(), 0.0)

    assert all(take(plan, 1.0) for _ in range(2 * JOBS_IN_ROW))


def test_a_stop_overtakes_an_overdue_poll_however_many_jobs_there_were() -> None:
    plan = begun(poll("a", every_s=0.0))
    for _ in range(10):
        plan.submit(job(Lane.STOP), 0.0)

    turns = [take(plan, 0.0) for _ in range(11)]

    assert [turn is not None and turn.job is not None for turn in turns] == [True] * 10 + [False]


def test_a_waiting_job_can_be_withdrawn_and_one_under_way_cannot() -> None:
    plan = begun()
    first, second = job(), job()
    plan.submit(first, 0.0)
    plan.submit(second, 0.0)

    assert plan.withdraw(second)
    assert not plan.withdraw(second)
    plan.pick(0.0)
    assert not plan.withdraw(first)
    assert plan.pick(0.0) is None


def test_all_waiting_jobs_can_be_taken_out() -> None:
    plan = begun()
    jobs = [job(Lane.READ_BACK), job(Lane.STOP)]
    for waiting in jobs:
        plan.submit(waiting, 0.0)

    assert plan.take_jobs() == (jobs[1], jobs[0])
    assert plan.take_jobs() == ()


def test_a_silent_unit_is_asked_ever_less_often_up_to_the_ceiling() -> None:
    plan = begun(poll("a", every_s=1.0))

    asked_s = ask_times(plan, [Silent()] * 9)

    assert gaps(asked_s) == [1.0, 1.0, 2.0, 4.0, 8.0, 16.0, 16.0, 16.0]


@pytest.mark.parametrize(
    ("every_s", "expected"), [(0.0, [0.0, 1.0, 2.0]), (5.0, [5.0, 5.0, 10.0]), (60.0, [60.0] * 3)]
)
def test_the_back_off_begins_at_the_polls_own_period(every_s: float, expected: list[float]) -> None:
    plan = begun(poll("a", every_s=every_s))

    assert gaps(ask_times(plan, [Silent()] * 4)) == expected


def test_a_unit_with_a_watchdog_is_asked_often_enough_for_it_for_it_may_hear_what_we_do_not() -> None:
    plan = begun(replace(poll("a", every_s=1.0), deadline_s=10.0))

    assert max(gaps(ask_times(plan, [Silent()] * 9))) == 1.25


def test_the_back_off_is_spread_by_a_tenth_either_way() -> None:
    plan = begun(poll("a", every_s=1.0), jitter=0.1, seed=7)

    late = gaps(ask_times(plan, [Silent()] * 200))[6:]

    assert min(late) >= 14.4
    assert max(late) <= 17.6
    assert max(late) - min(late) > 2.0


def test_a_silent_unit_is_asked_by_its_first_poll_only_and_in_full_once_it_answers() -> None:
    plan = begun(poll("status"), poll("current"), poll("other", unit=2))
    for _ in range(3):
        turn = plan.pick(0.0)
        assert turn is not None
        plan.record(turn, Silent() if turn.unit == 1 else ANSWERED, 0.0)

    assert plan.state_of(1) is UnitState.SILENT
    assert [it.key for it in plan.polls()] == ["status", "other"]
    assert [key_of(take(plan, at_s)) for at_s in (0.9, 1.0, 1.0)] == [None, "other", "status"]
    assert [it.key for it in plan.polls()] == ["status", "current", "other"]
    assert key_of(take(plan, 1.0)) == "current"


def test_an_answered_job_brings_a_silent_unit_back_too() -> None:
    plan = begun(poll("status"), poll("current"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())
    plan.submit(job(), 0.1)

    turn = plan.pick(0.1)
    assert turn is not None
    assert plan.record(turn, ANSWERED, 0.1) == Verdict(is_final=True, is_answering=True)

    assert {key_of(take(plan, 0.1)), key_of(take(plan, 0.1))} == {"status", "current"}


def test_jobs_that_a_silent_unit_does_not_answer_leave_its_back_off_alone() -> None:
    plan = begun(poll("status"))
    ask_times(plan, [Silent(), Silent()])
    due_s = plan.next_due_s()

    plan.submit(job(), 1.0)
    take(plan, 1.0, Silent())

    assert plan.next_due_s() == due_s


def test_a_change_of_a_units_state_is_told_once() -> None:
    plan = begun(poll("a", every_s=0.0))
    outcomes = [Silent(), ANSWERED, ANSWERED, Silent(), Silent(), Silent(), ANSWERED]

    told = []
    for outcome in outcomes:
        now_s = max(plan.next_due_s(), 100.0 * len(told))
        turn = plan.pick(now_s)
        assert turn is not None
        told.append(plan.record(turn, outcome, now_s).is_answering)

    assert told == [None, True, None, None, False, None, True]


def test_a_garbled_poll_is_repeated_once_at_once_and_counts_when_it_was_no_use() -> None:
    plan = begun(poll("a"), poll("b"))
    first = plan.pick(0.0)
    assert first is not None
    assert plan.record(first, GARBLED, 0.1) == Verdict(is_final=False)
    assert plan.state_of(1) is UnitState.NEW

    second = plan.pick(0.1)

    assert second is not None
    assert key_of(second) == "a"
    assert second.is_repetition
    assert plan.record(second, GARBLED, 0.2) == Verdict(is_final=True)
    assert plan.state_of(1) is UnitState.SUSPECT
    third = plan.pick(0.2)
    assert third is not None
    assert (key_of(third), third.is_repetition) == ("b", False)


def test_a_garbled_read_job_is_repeated_before_the_others_of_its_lane() -> None:
    plan = begun()
    read, other = job(Lane.READ_BACK, request=READ), job(Lane.READ_BACK, request=READ)
    plan.submit(read, 0.0)
    plan.submit(other, 0.0)

    first = plan.pick(0.0)
    assert first is not None
    assert not plan.record(first, GARBLED, 0.0).is_final
    again = plan.pick(0.0)

    assert again is not None
    assert again.job is read
    assert plan.record(again, GARBLED, 0.0).is_final


def test_a_garbled_write_is_never_repeated() -> None:
    plan = begun()
    plan.submit(job(request=WRITE), 0.0)

    turn = plan.pick(0.0)

    assert turn is not None
    assert plan.record(turn, GARBLED, 0.0).is_final
    assert plan.pick(0.0) is None


def test_what_was_not_sent_for_noise_is_not_repeated_at_once() -> None:
    plan = begun(poll("a", every_s=1.0))

    turn = plan.pick(0.0)

    assert turn is not None
    assert plan.record(turn, Garbled("noise", b"", is_sent=False), 0.0).is_final
    assert plan.pick(0.0) is None


def test_a_poll_that_is_put_back_lets_others_pass_and_a_job_stays_the_first() -> None:
    plan = begun(poll("a"), poll("b"))
    first, second = job(), job()
    turn = plan.pick(0.0)
    assert turn is not None
    plan.put_back(turn, 0.5)
    plan.submit(first, 0.0)
    plan.submit(second, 0.0)

    taken_back = plan.pick(0.0)
    assert taken_back is not None
    plan.put_back(taken_back, 0.5)

    turns = [take(plan, at_s) for at_s in (0.0, 0.0, 0.1, 0.1, 0.5)]
    assert [turn.job for turn in turns[:2] if turn] == [first, second]
    assert [key_of(turn) for turn in turns[2:]] == ["b", None, "a"]


def test_a_removed_poll_that_is_put_back_stays_removed() -> None:
    plan = begun(poll("a"))
    turn = plan.pick(0.0)
    assert turn is not None

    plan.remove_poll("a")
    plan.put_back(turn, 0.5)

    assert plan.next_due_s() == inf


def test_a_broadcast_says_nothing_of_any_unit() -> None:
    plan = begun()
    plan.submit(job(unit=0), 0.0)

    turn = plan.pick(0.0)

    assert turn is not None
    assert plan.record(turn, Silent("broadcast"), 0.0) == Verdict(is_final=True)
    assert plan.state_of(0) is UnitState.NEW


def test_an_expected_silence_leaves_the_unit_its_state_and_asks_only_its_probe() -> None:
    plan = begun(poll("status", every_s=0.2), poll("current", every_s=0.2))
    take(plan, 0.0)
    take(plan, 0.0)
    plan.expect_silence(1, 10.0)

    times_s = ask_times(plan, [Silent()] * 10)

    assert gaps(times_s) == pytest.approx([1.0] * 9)
    assert plan.state_of(1) is UnitState.ANSWERING
    assert take(plan, 10.3, ANSWERED) is not None
    assert len(plan.polls()) == 2


def test_an_expected_silence_ends_and_then_misses_count() -> None:
    plan = begun(poll("status"), poll("current"))
    plan.expect_silence(1, 2.0)

    for at_s in (0.0, 1.0, 2.0, 3.0):
        take(plan, at_s, Silent())

    assert plan.state_of(1) is UnitState.SILENT


def test_a_silence_can_be_expected_of_a_unit_without_polls() -> None:
    plan = begun()
    plan.expect_silence(9, 2.0)
    plan.submit(job(unit=9), 0.0)

    take(plan, 0.0, Silent())

    assert plan.state_of(9) is UnitState.NEW
    assert plan.next_due_s() == inf


def test_a_unit_without_polls_can_go_silent_and_its_first_poll_is_its_probe() -> None:
    plan = begun()
    for at_s in (0.0, 1.0, 2.0):
        plan.submit(job(unit=9), at_s)
        take(plan, at_s, Silent())
    assert plan.state_of(9) is UnitState.SILENT

    plan.add_poll(poll("probe", unit=9), 3.0)
    plan.add_poll(poll("held", unit=9), 3.0)

    assert key_of(take(plan, 3.0, Silent())) == "probe"
    assert [it.key for it in plan.polls()] == ["probe"]


def test_a_shorter_period_takes_effect_at_once_and_a_longer_one_after_the_next_turn() -> None:
    plan = begun(poll("a", every_s=10.0))
    take(plan, 0.0)

    plan.set_every("a", 0.2, 1.0)
    assert plan.next_due_s() == 1.2
    take(plan, 1.2)
    plan.set_every("a", 10.0, 1.2)

    assert plan.next_due_s() == pytest.approx(1.4)
    take(plan, 1.4)
    assert plan.next_due_s() == pytest.approx(11.4)


def test_a_silent_units_back_off_outlasts_a_change_of_period() -> None:
    plan = begun(poll("a", every_s=1.0))
    ask_times(plan, [Silent()] * 5)
    due_s = plan.next_due_s()

    plan.set_every("a", 0.2, 20.0)

    assert plan.next_due_s() == due_s


def test_a_hastened_poll_is_due_now() -> None:
    plan = begun(poll("a", every_s=10.0))
    take(plan, 0.0)

    plan.hasten("a", 3.0)

    assert plan.next_due_s() == 3.0
    take(plan, 3.0)
    assert plan.next_due_s() == 13.0


def test_a_poll_that_is_hastened_while_it_is_under_way_comes_once_more() -> None:
    plan = begun(poll("a", every_s=10.0))
    turn = plan.pick(0.0)
    assert turn is not None

    plan.hasten("a", 0.01)
    plan.record(turn, ANSWERED, 0.02)

    assert plan.next_due_s() == 0.02


def test_hastening_any_poll_of_a_silent_unit_hastens_its_probe() -> None:
    plan = begun(poll("status"), poll("current"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())

    plan.hasten("current", 0.5)

    assert key_of(take(plan, 0.5)) == "status"


def test_a_removed_poll_is_not_asked_and_its_answer_under_way_not_told() -> None:
    plan = begun(poll("a"), poll("b"))
    turn = plan.pick(0.0)
    assert turn is not None

    plan.remove_poll("a")
    plan.add_poll(poll("a", every_s=5.0), 0.0)

    assert plan.record(turn, ANSWERED, 0.0) == Verdict(is_final=False, is_answering=True)
    assert [key_of(take(plan, 0.0)) for _ in range(3)] == ["b", "a", None]


def test_when_the_probe_is_removed_the_next_poll_takes_its_place() -> None:
    plan = begun(poll("a"), poll("b"), poll("c"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())
    due_s = plan.next_due_s()

    plan.remove_poll("c")
    plan.remove_poll("a")

    assert plan.next_due_s() == due_s
    assert key_of(take(plan, due_s)) == "b"
    plan.remove_poll("b")
    assert plan.next_due_s() == inf


def test_a_poll_that_is_removed_before_its_repetition_is_not_repeated() -> None:
    plan = begun(poll("a"), poll("b"))
    turn = plan.pick(0.0)
    assert turn is not None
    plan.record(turn, GARBLED, 0.1)

    plan.remove_poll("a")

    assert key_of(take(plan, 0.1)) == "b"


def test_a_repetition_that_is_put_back_at_once_is_still_the_next() -> None:
    plan = begun(poll("a"), poll("b"))
    turn = plan.pick(0.0)
    assert turn is not None
    plan.record(turn, GARBLED, 0.1)
    again = plan.pick(0.1)
    assert again is not None

    plan.put_back(again, 0.1)

    third = plan.pick(0.1)
    assert third is not None
    assert (key_of(third), third.is_repetition) == ("a", True)


def test_what_was_hastened_keeps_its_hurry_when_it_is_put_back() -> None:
    plan = begun(poll("a", every_s=10.0), poll("b", every_s=10.0))
    take(plan, 0.0)
    take(plan, 0.0)
    plan.hasten("b", 3.0)
    plan.hasten("b", 3.0)  # does no more than once
    turn = plan.pick(3.0)
    assert turn is not None
    plan.put_back(turn, 3.0)
    plan.hasten("a", 3.0)

    assert {key_of(take(plan, 3.0)), key_of(take(plan, 3.0))} == {"a", "b"}
    assert plan.pick(3.0) is None


def test_after_an_outage_a_silent_unit_is_still_asked_by_its_probe_only() -> None:
    plan = begun(poll("a"), poll("b"))
    take(plan, 0.0, Silent())
    take(plan, 0.0, Silent())

    plan.begin(100.0)

    assert key_of(take(plan, 100.0, Silent())) == "a"
    assert plan.pick(100.0) is None


def test_after_an_outage_the_first_poll_of_each_unit_comes_before_what_we_ask_of_our_own_accord() -> None:
    plan = begun(poll("a", unit=1), poll("b", unit=1), poll("c", unit=2))
    plan.submit(job(Lane.READ_BACK), 0.0)

    assert [key_of(take(plan, 0.0)) for _ in range(3)] == ["a", "c", None]


def test_when_nobody_could_be_heard_all_are_asked_at_once() -> None:
    plan = begun(*(poll(f"{unit}", unit=unit) for unit in range(1, 31)))
    now_s = 0.0
    while now_s < 60.0:
        turn = plan.pick(now_s)
        now_s = now_s + 0.1 if turn is not None else plan.next_due_s()
        if turn is not None:
            plan.record(turn, Silent(), now_s)

    plan.hasten_all(now_s)

    answered = set()
    for _ in range(30):
        turn = take(plan, now_s)
        assert turn is not None
        answered.add(turn.unit)
    assert answered == set(range(1, 31))


def test_all_periods_are_stretched_by_one_factor_when_the_line_is_over_full() -> None:
    plan = begun(poll("a", every_s=1.0), poll("b", every_s=2.0), poll("c", every_s=4.0))
    seen = Counter[str | None]()
    now_s = 0.0

    while now_s < 2000.0:
        turn = plan.pick(now_s)
        now_s = now_s + 1.0 if turn is not None else plan.next_due_s()
        if turn is not None:
            plan.record(turn, ANSWERED, now_s)
            seen[key_of(turn)] += 1

    assert plan.stretch == pytest.approx(1.05 * 1.75)
    assert seen["a"] == pytest.approx(2 * seen["b"], rel=0.1)
    assert seen["b"] == pytest.approx(2 * seen["c"], rel=0.1)
    assert seen.total() == 2000  # no time is left idle


def test_a_poll_may_get_and_lose_its_period() -> None:
    plan = begun(poll("a", every_s=0.0), poll("b", every_s=0.0))
    take(plan, 0.0)

    plan.set_every("a", 5.0, 0.0)
    assert [key_of(take(plan, 0.0)) for _ in range(3)] == ["a", "b", "b"]
    plan.set_every("a", 0.0, 1.0)

    assert {key_of(take(plan, 1.0)), key_of(take(plan, 1.0))} == {"a", "b"}


def test_wrong_keys_are_refused() -> None:
    plan = begun(poll("a"))

    with pytest.raises(ValueError, match="'a' already"):
        plan.add_poll(poll("a"), 0.0)
    with pytest.raises(KeyError):
        plan.remove_poll("b")
    with pytest.raises(KeyError):
        plan.hasten("b", 0.0)
    with pytest.raises(KeyError):
        plan.set_every("b", 1.0, 0.0)


@settings(deadline=None)
@given(
    periods_s=st.lists(st.sampled_from([0.0, 0.05, 0.3, 1.0, 5.0]), min_size=1, max_size=12),
    jobs=st.lists(
        st.tuples(st.integers(0, 300), st.sampled_from([Lane.COMMAND, Lane.READ_BACK])), max_size=80
    ),
)
def test_no_poll_starves(periods_s: list[float], jobs: list[tuple[int, Lane]]) -> None:
    plan = begun(*(poll(str(at), unit=at + 1, every_s=every_s) for at, every_s in enumerate(periods_s)))
    by_step = Counter(jobs)
    last_s = dict.fromkeys(map(str, range(len(periods_s))), 0.0)
    longest_s = dict(last_s)
    most_stretched = 1.0

    for step in range(600):
        now_s = 0.03 * step
        for (at, lane), count in by_step.items():
            if at == step:
                for _ in range(count):
                    plan.submit(job(lane), now_s)
        turn = take(plan, now_s)
        most_stretched = max(most_stretched, plan.stretch)
        if turn is not None and turn.poll is not None:
            key = turn.poll.key
            longest_s[key] = max(longest_s[key], now_s - last_s[key])
            last_s[key] = now_s

    round_s = 0.03 * len(periods_s) * (JOBS_IN_ROW + 1) / FREE_ROOM + 0.03 * len(jobs)
    for key, gap_s in longest_s.items():
        every_s = periods_s[int(key)]
        bound_s = 2 * every_s * most_stretched + 0.03 * len(jobs) if every_s else round_s
        assert gap_s <= bound_s + 0.03 * (len(periods_s) + 1)
        assert 600 * 0.03 - last_s[key] <= bound_s + 0.03 * (len(periods_s) + 1)


@given(outcomes=st.lists(st.sampled_from([ANSWERED, GARBLED, Silent()]), max_size=60))
def test_a_unit_is_asked_for_ever_whatever_it_answers(outcomes: list[Outcome]) -> None:
    plan = begun(poll("a"), poll("b"), jitter=0.1)

    times_s = ask_times(plan, [*outcomes, ANSWERED, ANSWERED, ANSWERED])

    assert all(gap_s <= 17.6 for gap_s in gaps(times_s))
    assert len(plan.polls()) == 2
