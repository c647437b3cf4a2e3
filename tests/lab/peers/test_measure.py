"""Whether the comparison counts rightly."""

from __future__ import annotations

from math import inf

from tests.lab.peers.contenders import Ours
from tests.lab.peers.measure import (
    CURRENT,
    CURRENT_PCT,
    RUNNING,
    Published,
    StarterBook,
    longest_old_s,
    longest_stall_s,
    lost,
    wrong,
)

STEPS = ((0.0, 10.0), (3.0, 10.6), (6.0, 11.2), (9.0, 11.8))


def published(at_s: float, value: float | None, *, point: str = CURRENT, is_live: bool = True) -> Published:
    return Published("pump", point, value, at_s, at_s, is_live)


def books(**fields: object) -> dict[str, StarterBook]:
    return {"pump": StarterBook(steps=STEPS, running=((0.0, 1.0),), **fields)}  # type: ignore[arg-type]


def test_a_step_that_was_never_published_is_lost() -> None:
    assert lost(books(), [published(1.0, 10.0), published(7.0, 11.2)], 0.0, 20.0) == (1, 3)


def test_a_step_that_was_published_later_in_the_history_is_not_lost() -> None:
    late = published(15.0, 10.6, is_live=False)

    assert lost(books(), [published(1.0, 10.0), late, published(7.0, 11.2)], 0.0, 20.0) == (0, 3)


def test_steps_before_the_mark_and_those_that_have_hardly_ended_do_not_count() -> None:
    assert lost(books(), [], 1.0, 8.5) == (1, 1)


def test_what_no_master_could_read_is_not_lost() -> None:
    assert lost(books(away=((4.0, 7.0),)), [published(1.0, 10.0)], 0.0, 20.0) == (0, 1)


def test_a_value_is_wrong_that_the_starter_did_not_have_about_then() -> None:
    mixed_up, long_ago = published(10.0, 10.1), published(30.0, 10.0)

    assert wrong(books(), [published(10.0, 11.8), mixed_up, long_ago], 0.0) == [mixed_up, long_ago]


def test_a_value_with_its_own_time_may_arrive_much_later() -> None:
    queued = Published("pump", CURRENT, 10.0, received_s=60.0, time_s=2.0)

    assert wrong(books(), [queued], 0.0) == []


def test_a_value_of_another_point_is_wrong() -> None:
    right, mixed_up = published(1.0, 11.8, point=CURRENT_PCT), published(1.0, 10.0, point=CURRENT_PCT)

    assert wrong(books(), [right, mixed_up, published(1.0, 0.0, point=RUNNING)], 0.0) == [
        mixed_up,
        published(1.0, 0.0, point=RUNNING),
    ]


def test_a_value_stands_as_good_until_it_is_replaced_or_marked() -> None:
    replaced = [published(1.0, 10.0), published(8.0, 11.2), published(9.5, 11.8)]
    marked = [published(1.0, 10.0), published(4.0, None), published(9.5, 11.8)]

    assert longest_old_s(books(), replaced, 0.0, 20.0) == 5.0
    assert longest_old_s(books(), marked, 0.0, 20.0) == 1.0


def test_no_value_of_a_dead_starter_is_right() -> None:
    assert longest_old_s(books(away=((9.5, inf),)), [published(9.1, 11.8)], 9.2, 20.0) == 10.5


def test_history_does_not_change_what_is_shown() -> None:
    history = published(9.5, 10.0, is_live=False)

    assert longest_old_s(books(), [published(9.1, 11.8), history], 9.2, 20.0) == 0.0


def test_the_longest_stall_is_that_of_a_living_starter() -> None:
    both = {
        "pump": StarterBook(steps=STEPS, running=(), requests_s=(1.0, 2.0, 6.0)),
        "fan": StarterBook(steps=STEPS, running=(), requests_s=(1.0,), away=((2.0, inf),)),
    }

    assert longest_stall_s(both, 0.0, 8.0) == 4.0


def test_a_gateway_that_says_offline_has_nothing_good_any_more() -> None:
    found = list(Ours().read("starters/plant/gateway/status", {"state": "offline", "boot": "x"}, 5.0))

    assert {each.value for each in found} == {None}
    assert {each.starter for each in found} == {"pump", "fan", "mill", "belt"}
