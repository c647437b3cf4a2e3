"""The non-volatile memory of a starter is not worn out, however often a program sets something."""

from __future__ import annotations

import math

from gateway.starters.policy.write_budget import HOUR_S, WriteBudget

P313, P314 = 313, 314


def test_as_many_writes_as_the_limit_go_within_an_hour_and_the_next_must_wait_for_the_first_to_age() -> None:
    wear = WriteBudget(3)

    waits = [wear.take("pump", 1, now_s=now_s) for now_s in (0.0, 600.0, 1200.0, 1800.0)]

    assert waits == [None, None, None, HOUR_S - 1800.0]
    assert wear.take("pump", 1, now_s=HOUR_S) is None
    assert wear.total("pump") == 4


def test_several_writes_wait_until_there_is_room_for_all() -> None:
    wear = WriteBudget(3)
    wear.take("pump", 1, now_s=0.0)
    wear.take("pump", 1, now_s=100.0)

    assert wear.take("pump", 3, now_s=200.0) == HOUR_S - 100.0
    assert wear.total("pump") == 2


def test_more_writes_than_the_limit_never_go() -> None:
    wait_s = WriteBudget(3).take("pump", 4, now_s=0.0)

    assert wait_s == math.inf
    assert WriteBudget(3).refusal(math.inf).text.endswith("this command has more")


def test_each_starter_has_its_own_count() -> None:
    wear = WriteBudget(1)

    assert wear.take("pump", 1, now_s=0.0) is None
    assert wear.take("fan", 1, now_s=0.0) is None
    assert wear.total("mixer") == 0


def test_what_writes_nothing_that_is_stored_is_never_refused() -> None:
    wear = WriteBudget(1)
    wear.take("pump", 1, now_s=0.0)

    assert wear.take("pump", 0, now_s=0.0) is None


def test_a_refusal_says_when_to_try_again() -> None:
    assert WriteBudget(3).refusal(61.0).text.endswith("try again in 2 min")


def test_each_count_is_reported_with_the_hour_and_the_total() -> None:
    values: list[tuple[str, int]] = []
    wear = WriteBudget(10, on_count=lambda *what: values.append(what))
    wear.restore({"pump": 240})

    wear.take("pump", 1, now_s=0.0)
    wear.take("pump", 2, now_s=1.0)
    wear.take("pump", 0, now_s=2.0)

    assert values == [("pump", 1), ("pump", 2)]
    assert (wear.last_hour("pump"), wear.total("pump")) == (3, 243)
    assert wear.totals() == {"pump": 243}
