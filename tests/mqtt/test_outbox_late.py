from __future__ import annotations

from gateway.mqtt.outbox.outbox import Outbox
from tests.mqtt.outboxes import (
    STATUS,
    WIDE,
    acknowledge,
    event,
    late,
    latest,
    outbox,
    pack,
    result,
    take_all,
    texts,
    value,
)


def test_a_value_in_flight_when_the_connection_broke_is_reported_as_history_if_it_was_overtaken() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(value(1), 0.0)
    take_all(box)
    box.put(value(2), 0.0)
    take_all(box)

    box.disconnected()
    box.connected(WIDE)

    assert texts(take_all(box)) == ["v/p=2", "h/p=1"]


def test_a_full_outbox_drops_history_first_then_events_and_results_last() -> None:
    box = outbox(max_rows=4)
    box.put(result("1"), 0.0)
    box.put(event("1"), 0.0)
    box.put(result("2"), 0.0)
    for number in range(3):
        box.put(value(number), 0.0)
    assert box.dropped == 2

    box.put(event("2"), 0.0)
    assert box.dropped == 2  # the newest value will be reported live
    box.put(result("3"), 0.0)
    assert box.dropped == 3
    box.put(result("4"), 0.0)
    assert box.dropped == 4
    box.put(result("5"), 0.0)
    assert box.dropped == 5

    box.connected(WIDE)
    assert texts(take_all(box)) == ["v/p=2", "r=2", "r=3", "r=4", "r=5"]


def test_values_reported_late_wait_until_they_are_granted() -> None:
    box = Outbox(last_topic=STATUS, pack=pack, late=late, boot="run")
    for number in range(1, 303):
        box.put(value(number), 0.0)
    box.connected(WIDE)

    assert texts(take_all(box)) == ["v/p=302"]

    box.grant_history(100)
    (first,) = take_all(box)
    box.grant_history(250)
    second, third = take_all(box)
    assert [len(sent.message.payload.split(b",")) for sent in (first, second, third)] == [100, 200, 1]


def test_a_newest_value_that_waited_and_was_overtaken_on_its_way_is_reported_once() -> None:
    box = outbox()
    box.put(value(1), 0.0)
    box.connected(WIDE)
    first = take_all(box)
    box.put(value(2), 0.0)
    second = take_all(box)
    acknowledge(box, [*first, *second])

    assert box.is_idle
    assert texts([*first, *second]) == ["v/p=1", "v/p=2"]


def test_a_stored_newest_value_that_there_was_no_room_for_is_lost_only_when_it_is_overtaken() -> None:
    box = outbox(max_rows=1)
    box.put(value(1), 0.0)
    box.put(result("1"), 0.0)
    assert box.dropped == 0

    box.put(value(2), 0.0)

    assert box.dropped == 1
    box.connected(WIDE)
    taken = take_all(box)
    acknowledge(box, taken)
    assert texts(taken) == ["v/p=2", "r=1"]
    assert box.is_idle


def test_events_of_an_outage_give_way_to_every_second_live_value() -> None:
    box = outbox()
    for number in range(4):
        box.put(event(str(number)), 0.0)
    box.connected(WIDE)
    for topic in "abc":
        box.put(latest(topic, "1"), 0.0)

    assert texts(take_all(box)) == ["e=0", "a=1", "e=1", "b=1", "e=2", "c=1", "e=3"]


def test_news_and_results_do_not_wait_for_the_events_of_an_outage() -> None:
    box = outbox()
    for number in range(3):
        box.put(event(str(number)), 0.0)
    box.connected(1)
    (first,) = take_all(box)
    box.put(result("new"), 0.0)

    acknowledge(box, [first])

    assert texts(take_all(box)) == ["r=new"]
