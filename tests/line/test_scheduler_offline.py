"""Units that do not answer: they take little of the line, and are back at once when they answer again."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Silent
from gateway.line.scheduler.polls import OFFLINE_BURST_S, OFFLINE_SHARE
from gateway.line.scheduler.requests import Poll, Slot
from gateway.line.scheduler.scheduler import Scheduler
from tests.line.fakes import poll
from tests.line.ideal_line import IdealLine

ANSWER_S, SILENCE_S = 0.03, 0.08


class Plant(IdealLine):
    """A line some of whose units are dead."""

    def __init__(self, polls: list[Poll], dead: set[int], *, seed: int = 0) -> None:
        self.dead = dead
        self.dead_s = 0.0  # of the line's time, after a unit was noticed to be silent
        super().__init__(polls, self._time_of, self._outcome_of, seed=seed)

    def _time_of(self, slot: Slot) -> float:
        if slot.unit not in self.dead:
            return ANSWER_S
        if self.scheduler.polls.unit(slot.unit).state.value == "silent":
            self.dead_s += SILENCE_S
        return SILENCE_S

    def _outcome_of(self, slot: Slot, at_s: float) -> Outcome:
        return Silent() if slot.unit in self.dead else Answered((), at_s, 0.0)


def polls_of(units: int, every_s: float = 1.0) -> list[Poll]:
    return [poll(f"{unit}/{at}", unit, every_s) for unit in range(1, units + 1) for at in range(2)]


def state(plant: Plant, unit: int) -> str:
    return plant.scheduler.polls.unit(unit).state.value


@settings(deadline=None, max_examples=15)
@given(
    units=st.integers(1, 60),
    dead_share=st.sampled_from([0.1, 0.5, 0.9, 1.0]),
    every_s=st.sampled_from([0.0, 0.2, 1.0, 5.0]),
    seed=st.integers(0, 3),
)
def test_all_silent_units_together_never_take_more_than_their_share(
    units: int, dead_share: float, every_s: float, seed: int
) -> None:
    dead = set(range(1, max(int(units * dead_share), 1) + 1))
    plant = Plant(polls_of(units, every_s), dead, seed=seed)

    for until_s in range(1, 120):
        plant.run(until_s)
        assert plant.dead_s <= OFFLINE_SHARE * plant.now_s + OFFLINE_BURST_S + SILENCE_S


@pytest.mark.parametrize("every_s", [0.0, 0.2])
@pytest.mark.parametrize(
    ("dead", "units"),
    [(1, 1), (2, 8), (6, 8), (60, 247)],
)
def test_the_dead_take_a_twentieth_of_a_full_line_at_most_however_many_they_are(
    dead: int, units: int, every_s: float
) -> None:
    plant = Plant(polls_of(units, every_s), set(range(1, dead + 1)), seed=dead)
    while any(state(plant, unit) != "silent" for unit in plant.dead):
        plant.step()
    plant.run(plant.now_s + 2 * OFFLINE_BURST_S / OFFLINE_SHARE)
    plant.busy_s.clear()
    noticed_s = plant.now_s

    plant.run(noticed_s + 300.0)

    passed_s = plant.now_s - noticed_s
    assert plant.busy_s["Silent"] <= OFFLINE_SHARE * passed_s + SILENCE_S
    if dead < units and (every_s == 0.0 or 2 * (units - dead) * ANSWER_S > every_s):
        assert plant.busy_s["Answered"] >= 0.98 * (passed_s - plant.busy_s["Silent"])


def test_a_silence_is_not_followed_by_another_while_a_living_unit_is_due() -> None:
    plant = Plant(polls_of(12, every_s=0.0), {1, 2, 3})

    plant.run(60.0)

    units = [slot.unit for at_s, slot in plant.slots if at_s > 2.0]
    assert not any(one in plant.dead and other in plant.dead for one, other in itertools.pairwise(units))


class NoisyLine(IdealLine):
    """A line on which three bytes in a hundred are corrupted: requests of 8 bytes, replies of 25."""

    def __init__(self, polls: list[Poll], *, seed: int) -> None:
        self.chance = random.Random(seed)
        self.reached_s: dict[int, float] = {}  # the latest request that a unit understood
        self.unreached_s = 0.0  # the longest time between two of these
        super().__init__(polls, lambda slot: 0.06, self._outcome_of_noise, seed=seed)

    def _outcome_of_noise(self, slot: Slot, at_s: float) -> Outcome:
        if self.chance.random() > 0.97**8:
            return Silent()
        self.unreached_s = max(self.unreached_s, at_s - self.reached_s.get(slot.unit, at_s))
        self.reached_s[slot.unit] = at_s
        return Answered((), at_s, 0.0) if self.chance.random() < 0.97**25 else Garbled("bad CRC", b"\x01\x03")


@pytest.mark.parametrize("seed", [0])
def test_noise_does_not_let_the_watchdogs_act_where_requests_arrive_now_and_then(
    seed: int,
) -> None:
    polls = [replace(each, deadline_s=10.0) for each in polls_of(4)]
    line = NoisyLine(polls, seed=seed)

    line.run(1200.0)

    assert line.unreached_s < 10.0


def test_a_unit_is_late_as_long_as_its_latest_reply_was_and_for_30_s_at_most() -> None:
    scheduler = Scheduler([poll("a", 1)])
    scheduler.polls.begin(0.0)
    assert not scheduler.polls.unit(1).is_late(0.0)

    scheduler.polls.unit(1).note_late(10.0)
    assert scheduler.polls.unit(1).is_late(10.0)
    assert scheduler.polls.unit(1).is_late(39.9)
    assert not scheduler.polls.unit(1).is_late(40.1)

    scheduler.polls.unit(1).note_late(50.0)
    slot = scheduler.pick(51.0)
    assert slot is not None
    scheduler.record(slot, Answered((), 51.0, 0.0), 51.0)
    assert not scheduler.polls.unit(1).is_late(51.0)


def test_an_answer_that_may_be_a_late_one_is_no_return() -> None:
    """A serial server may deliver what a unit said before it died: a series of equal answers decides."""
    scheduler = Scheduler([poll("1/0", 1, 1.0)])
    scheduler.polls.begin(0.0)
    now_s, news = 0.0, None

    def slot_at(at_s: float) -> Slot:
        slot = scheduler.pick(at_s)
        while slot is None:
            at_s += 1.0
            slot = scheduler.pick(at_s)
        return slot

    while news is not False:
        now_s += 20.0
        news = scheduler.record(slot_at(now_s), Silent(), now_s + 0.1).is_answering

    now_s += 60.0
    late = Answered((), now_s + 0.1, 0.0)
    verdict = scheduler.record(slot_at(now_s), late, now_s + 0.1, is_open=True, is_unsure=True)
    assert verdict.is_answering is None

    again = scheduler.pick(now_s + 0.2)
    assert again is not None  # at once
    assert scheduler.record(again, late, now_s + 0.3).is_answering is True
