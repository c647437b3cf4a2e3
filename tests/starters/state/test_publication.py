"""Whatever the readings and their times: no change is lost, none comes too soon, none too late."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import Quality
from gateway.starters.state.publication import REFRESH_S, SOONEST_S, Published, due_values, is_news
from gateway.starters.state.readings import Reading, Value
from gateway.starters.state.starter_state import StarterState

DEADBAND = 1.0
EPSILON_S = 1e-9


class Step(NamedTuple):
    after_s: float
    value: float
    quality: Quality


class Sent(NamedTuple):
    at_s: float
    reading: Reading


steps = st.lists(
    st.builds(
        Step,
        after_s=st.sampled_from([0.0, 0.01, 0.1, 0.2, 0.25, 0.3, 1.0, 29.0, 299.0, 301.0]),
        value=st.floats(-5, 5, allow_nan=False),
        quality=st.sampled_from([Quality.GOOD, Quality.GOOD, Quality.STALE]),
    ),
    min_size=1,
    max_size=40,
)


def play(story: list[Step]) -> tuple[list[Sent], list[Reading], list[float]]:
    """Read in time and publish exactly when that is due; return what was published and read."""
    before, sent, found = Published(status_s=float("inf")), list[Sent](), list[Reading]()
    read_s: list[float] = []
    state, now_s = StarterState({}), 0.0

    def publish(at_s: float) -> None:
        nonlocal before
        before, values = due_values(before, state, {"p": DEADBAND}, now_s=at_s)
        sent.extend(Sent(at_s, each) for each in values.values())

    for step in story:
        end_s = now_s + step.after_s
        while found and before.next_due_s <= end_s:
            now_s = before.next_due_s
            publish(now_s)
        now_s = end_s
        found.append(Reading(step.value, "A", step.quality))
        read_s.append(now_s)
        state = StarterState({"p": found[-1]})
        publish(now_s)
    while before.waiting:
        publish(before.next_due_s)
    return sent, found, read_s


@given(steps)
def test_no_point_is_published_too_soon_or_too_late(story: list[Step]) -> None:
    sent, _, _ = play(story)

    gaps_s = [later.at_s - earlier.at_s for earlier, later in itertools.pairwise(sent)]
    assert all(SOONEST_S - EPSILON_S <= gap_s <= REFRESH_S + EPSILON_S for gap_s in gaps_s)


@given(steps)
def test_the_newest_reading_is_published_and_no_change_is_lost(story: list[Step]) -> None:
    sent, found, read_s = play(story)

    for at_s, reading in sent:
        place = next(place for place, each in enumerate(found) if each is reading)
        assert not [each_s for each_s in read_s if read_s[place] < each_s < at_s]
    final, last = sent[-1].reading, found[-1]
    assert final.quality is last.quality
    assert abs(float(final.value or 0) - float(last.value or 0)) <= DEADBAND


def reading(value: Value, quality: Quality = Quality.GOOD, *, label: str | None = None) -> Reading:
    return Reading(value, "A", quality, label)


@pytest.mark.parametrize(
    ("before", "now", "deadband", "expected"),
    [
        (reading(1.0), reading(1.0), 0.0, False),
        (reading(1.0), reading(1.1), 0.0, True),
        (reading(1.0), reading(1.0, Quality.STALE), 5.0, True),
        (reading(1, label="on"), reading(1, label="off"), 5.0, True),
        (reading(None), reading(1.0), 5.0, True),
        (reading(1.0), reading(None), 5.0, True),
        (reading(None), reading(None), 0.0, False),
        (reading(False), reading(True), 5.0, True),
        (reading("a"), reading("b"), 5.0, True),
        (reading("a"), reading("a"), 0.0, False),
        (reading(7), reading(12), 5.0, False),
        (reading(7), reading(13), 5.0, True),
    ],
)
def test_news_is_a_change_of_quality_or_beyond_the_deadband(
    before: Reading, now: Reading, deadband: float, *, expected: bool
) -> None:
    assert is_news(before, now, deadband) is expected
