"""The first hour of the recorded day; `tests/end_to_end/test_day.py` plays it whole."""

from __future__ import annotations

import pytest

from tests.rig.day import HOUR_S, day, differences, recorded, until


@pytest.mark.long
def test_an_hour_publishes_what_is_recorded_whatever_its_chance() -> None:
    assert differences(until(recorded(), HOUR_S), day(HOUR_S, seed=1)) == ""


def test_a_difference_is_shown_by_topic_with_its_time() -> None:
    was = ['0 a/state 1R {"state":"ready"}', "5000 b 0 1", "10 a/state 1 2"]
    is_ = ['0 a/state 1R {"state":"fault"}', "5000 b 0 1", "10 c 1 2"]

    shown = differences(was, is_)

    assert shown.splitlines() == [
        "2 of 3 topics differ; the first difference of each:",
        "a/state, message 1 of 2 (now 1)",
        '  was 0:00:00 1R {"state":"ready"}',
        '  is  0:00:00 1R {"state":"fault"}',
        "c, message 1 of 0 (now 1)",
        "  was missing",
        "  is  0:00:05.010000 1 2",
    ]
    assert differences(was, [*was[:2][::-1], was[2]]) != ""
