from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.mqtt.outbox import Outbox, Outgoing
from gateway.mqtt.payload import HistoryItem, Message

STATUS = "b/gateway/status"
WIDE = 1000  # a window that never fills


def pack(topic: str, items: Sequence[str]) -> Message:
    return Message(topic, ",".join(items).encode(), qos=1, retain=False, is_kept=True, is_droppable=True)


def outbox(**limits: int) -> Outbox:
    return Outbox(last_topic=STATUS, pack=pack, **limits)


def latest(topic: str, text: str = "", *, qos: int = 1, history: HistoryItem | None = None) -> Message:
    return Message(topic, text.encode(), qos=qos, retain=True, history=history)


def value(number: int, *, starter: str = "p") -> Message:
    return latest(f"v/{starter}", str(number), history=HistoryItem(f"h/{starter}", str(number)))


def event(text: str) -> Message:
    return Message("e", text.encode(), qos=1, retain=False, is_kept=True, is_droppable=True)


def result(text: str) -> Message:
    return Message("r", text.encode(), qos=1, retain=False, is_kept=True)


def take_all(box: Outbox) -> list[Outgoing]:
    taken: list[Outgoing] = []
    while (outgoing := box.take()) is not None:
        taken.append(outgoing)
    return taken


def texts(taken: Sequence[Outgoing]) -> list[str]:
    return [f"{outgoing.message.topic}={outgoing.message.payload.decode()}" for outgoing in taken]


def acknowledge(box: Outbox, taken: Sequence[Outgoing]) -> None:
    for outgoing in taken:
        box.acked(outgoing.ticket, 0)


def test_nothing_is_sent_without_a_connection() -> None:
    box = outbox()

    box.put(latest("a", "1"), 0.0)
    box.put(event("1"), 0.0)

    assert box.take() is None
    assert not box.is_idle


def test_a_connection_hears_every_retained_topic_then_the_status_then_the_rest_in_order() -> None:
    box = outbox()
    box.put(latest(STATUS, "online"), 0.0)
    box.put(event("1"), 0.0)
    box.put(latest("a", "1"), 0.0)
    box.put(latest("a", "2"), 0.0)
    box.put(result("1"), 0.0)
    box.put(latest("b", "1", qos=0), 0.0)

    box.connected(WIDE)

    assert texts(take_all(box)) == ["a=2", "b=1", f"{STATUS}=online", "e=1", "r=1"]


def test_a_connection_without_a_status_yet_works_too() -> None:
    box = outbox()
    box.put(latest("a", "1"), 0.0)

    box.connected(WIDE)

    assert texts(take_all(box)) == ["a=1"]


def test_news_during_the_opening_does_not_come_before_the_status() -> None:
    box = outbox()
    box.put(latest(STATUS, "starting"), 0.0)
    box.put(latest("a", "1"), 0.0)
    box.connected(WIDE)

    first = box.take()
    box.put(latest("b", "1"), 0.0)
    box.put(event("1"), 0.0)
    box.put(latest(STATUS, "online"), 0.0)

    assert first is not None
    assert texts([first, *take_all(box)]) == ["a=1", f"{STATUS}=online", "e=1", "b=1"]


def test_only_the_newest_of_a_retained_topic_is_sent() -> None:
    box = outbox()
    box.connected(WIDE)

    for number in range(3):
        box.put(latest("a", str(number)), 0.0)

    assert texts(take_all(box)) == ["a=2"]
    assert box.take() is None


def test_results_and_events_overtake_values_and_keep_their_order() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(latest("a", "1"), 0.0)
    box.put(event("1"), 0.0)
    box.put(result("1"), 0.0)
    box.put(event("2"), 0.0)

    assert texts(take_all(box)) == ["e=1", "r=1", "e=2", "a=1"]


def test_the_window_holds_until_an_acknowledgement() -> None:
    box = outbox()
    box.connected(2)
    for number in range(3):
        box.put(event(str(number)), 0.0)

    taken = take_all(box)
    assert texts(taken) == ["e=0", "e=1"]

    box.acked(taken[0].ticket, 0)
    assert texts(take_all(box)) == ["e=2"]


def test_qos_0_takes_no_place_in_the_window() -> None:
    box = outbox()
    box.connected(1)
    for topic in "abc":
        box.put(latest(topic, "1", qos=0), 0.0)

    assert texts(take_all(box)) == ["a=1", "b=1", "c=1"]
    assert box.is_idle


def test_qos_0_news_without_a_connection_is_no_backlog() -> None:
    box = outbox()

    box.put(latest("a", "1", qos=0), 0.0)

    assert box.is_idle
    box.connected(WIDE)
    assert texts(take_all(box)) == ["a=1"]


def test_what_was_not_acknowledged_is_sent_again_in_its_old_order() -> None:
    box = outbox()
    box.connected(WIDE)
    for number in range(4):
        box.put(event(str(number)), 0.0)
    taken = take_all(box)
    box.acked(taken[1].ticket, 0)

    box.disconnected()
    box.put(event("4"), 0.0)
    box.connected(WIDE)

    assert texts(take_all(box)) == ["e=0", "e=2", "e=3", "e=4"]


def test_an_acknowledgement_of_an_earlier_connection_is_ignored() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(event("0"), 0.0)
    (taken,) = take_all(box)
    box.disconnected()

    box.acked(taken.ticket, 0)
    box.connected(WIDE)

    assert texts(take_all(box)) == ["e=0"]


def test_a_refusal_is_set_aside_and_counted_and_not_sent_again() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(event("0"), 0.0)
    box.put(latest("a", "1"), 0.0)
    first, second = take_all(box)

    box.acked(first.ticket, 0x87)
    box.acked(second.ticket, 0x10)  # no matching subscribers: a success

    assert box.refused == 1
    assert list(box.refusals) == [("e", 0x87)]
    assert box.is_idle


def test_values_overtaken_without_a_connection_are_told_in_batches_after_everything_else() -> None:
    box = outbox()
    for number in range(1, 303):
        box.put(value(number), 0.0)
    for number in range(3):
        box.put(value(number, starter="q"), 0.0)
    box.put(event("1"), 0.0)

    box.connected(WIDE)
    taken = take_all(box)

    assert texts(taken)[:3] == ["v/p=302", "v/q=2", "e=1"]
    assert [outgoing.message.topic for outgoing in taken[3:]] == ["h/p", "h/p", "h/q"]
    batches = [outgoing.message.payload.decode().split(",") for outgoing in taken[3:]]
    assert batches == [
        [str(number) for number in range(1, 201)],
        [str(number) for number in range(201, 302)],
        ["0", "1"],
    ]


def test_a_value_that_was_acknowledged_is_not_told_again_as_history() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(value(1), 0.0)
    acknowledge(box, take_all(box))

    box.disconnected()
    box.connected(WIDE)
    box.put(value(2), 0.0)

    assert texts(take_all(box)) == ["v/p=2"]
    assert box.take() is None


def test_a_value_in_flight_when_the_connection_broke_is_told_as_history_if_it_was_overtaken() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(value(1), 0.0)
    take_all(box)
    box.put(value(2), 0.0)
    take_all(box)

    box.disconnected()
    box.connected(WIDE)

    assert texts(take_all(box)) == ["v/p=2", "h/p=1"]


def test_a_value_in_flight_when_the_connection_broke_counts_as_unsent() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(value(1), 0.0)
    take_all(box)

    box.disconnected()
    box.put(value(2), 0.0)
    box.connected(WIDE)

    assert texts(take_all(box)) == ["v/p=2", "h/p=1"]


def test_a_repetition_for_a_new_connection_is_no_news_when_that_one_breaks_too() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(value(1), 0.0)
    acknowledge(box, take_all(box))
    box.disconnected()
    box.connected(WIDE)
    take_all(box)

    box.disconnected()

    assert box.is_idle
    assert box.figures(5.0)["depth"] == 0


def test_history_that_was_not_acknowledged_is_sent_again() -> None:
    box = outbox()
    box.put(value(1), 0.0)
    box.put(value(2), 0.0)
    box.connected(WIDE)
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
    assert box.dropped == 1

    box.put(event("2"), 0.0)
    assert box.dropped == 2
    box.put(result("3"), 0.0)
    assert box.dropped == 3
    box.put(result("4"), 0.0)
    assert box.dropped == 4
    box.put(result("5"), 0.0)
    assert box.dropped == 5

    box.connected(WIDE)
    assert texts(take_all(box)) == ["v/p=2", "r=2", "r=3", "r=4", "r=5"]


def test_the_bytes_are_bounded_too() -> None:
    box = outbox(max_bytes=3000)

    for _ in range(10):
        box.put(event("x" * 1000), 0.0)

    assert box.dropped == 8
    assert box.figures(0.0)["bytes"] == 2 * (1000 + 21 + 200)


def test_a_message_beyond_all_bounds_is_dropped_and_leaves_nothing_behind() -> None:
    box = outbox(max_bytes=1000)

    box.put(event("x" * 1000), 0.0)

    assert box.dropped == 1
    assert box.is_idle
    assert box.figures(0.0)["bytes"] == 0


def test_what_is_in_flight_is_not_dropped() -> None:
    box = outbox(max_bytes=3000)
    box.connected(WIDE)
    box.put(event("x" * 1000), 0.0)
    box.put(event("x" * 1000), 0.0)
    taken = take_all(box)

    box.put(event("y" * 1000), 0.0)

    assert box.dropped == 1
    box.disconnected()
    box.connected(WIDE)
    assert [outgoing.ticket for outgoing in take_all(box)] == [outgoing.ticket for outgoing in taken]


def test_a_packed_batch_that_no_longer_fits_is_dropped_whole() -> None:
    box = Outbox(last_topic=STATUS, pack=lambda topic, _: pack(topic, ["x" * 9000]), max_bytes=2000)
    box.put(value(1), 0.0)
    box.put(value(2), 0.0)
    box.connected(WIDE)

    assert texts(take_all(box)) == ["v/p=2"]
    assert box.dropped == 1


def test_a_forgotten_branch_is_cleared_once() -> None:
    box = outbox()
    box.connected(WIDE)
    for topic in ("s/p/state", "s/p/value/a", "s/p2/state"):
        box.put(latest(topic, "1"), 0.0)
    acknowledge(box, take_all(box))

    box.forget("s/p", 0.0)
    taken = take_all(box)
    acknowledge(box, taken)

    assert texts(taken) == ["s/p/state=", "s/p/value/a="]
    box.disconnected()
    box.connected(WIDE)
    assert texts(take_all(box)) == ["s/p2/state=1"]


def test_a_forgotten_topic_that_came_back_before_the_acknowledgement_stays() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(latest("s/p/state", "1"), 0.0)
    acknowledge(box, take_all(box))
    box.forget("s/p", 0.0)
    taken = take_all(box)

    box.put(latest("s/p/state", "2"), 0.0)
    acknowledge(box, taken)

    assert texts(take_all(box)) == ["s/p/state=2"]


def test_the_figures_tell_how_much_waits_and_since_when() -> None:
    box = outbox()
    assert box.figures(0.0) == {
        "depth": 0,
        "oldest_s": 0.0,
        "bytes": 0,
        "dropped": 0,
        "refused": 0,
        "reconnects": 0,
    }
    for _ in range(3):
        box.connected(1)
        box.disconnected()

    box.put(value(1), 10.0)
    box.put(value(2), 11.0)
    box.put(event("1"), 12.0)
    box.connected(1)
    (taken,) = take_all(box)

    assert box.figures(15.0)["depth"] == 3
    assert box.figures(15.0)["oldest_s"] == 5.0
    assert box.figures(15.0)["reconnects"] == 3
    box.acked(taken.ticket, 0)
    assert box.figures(15.0)["depth"] == 2
    while not box.is_idle:
        acknowledge(box, take_all(box))
    assert box.figures(15.0)["bytes"] == 0


@given(st.lists(st.sampled_from(["put", "connect", "disconnect", "take", "ack", "refuse"]), max_size=80))
def test_kept_messages_arrive_in_order_and_none_is_missing(steps: list[str]) -> None:
    box = outbox()
    flying: list[Outgoing] = []
    sent: list[int] = []
    count = 0
    is_connected = False

    for step in [*steps, "disconnect", "connect", *["take", "ack"] * 100]:
        if step == "put":
            box.put(event(str(count)), 0.0)
            count += 1
        elif step == "connect" and not is_connected:
            box.connected(2)
            is_connected = True
        elif step == "disconnect" and is_connected:
            box.disconnected()
            flying.clear()
            is_connected = False
        elif step == "take" and (outgoing := box.take()) is not None:
            flying.append(outgoing)
            sent.append(int(outgoing.message.payload))
        elif step in ("ack", "refuse") and flying:
            box.acked(flying.pop(0).ticket, 0x87 if step == "refuse" else 0)
        assert len(flying) <= 2

    assert list(dict.fromkeys(sent)) == list(range(count))
    assert box.is_idle
    assert box.figures(0.0)["bytes"] == 0


@pytest.mark.parametrize("window", [1, 3])
def test_never_more_than_the_window_is_in_flight(window: int) -> None:
    box = outbox()
    for number in range(20):
        box.put(value(number), 0.0)
        box.put(latest(f"t{number}", "1"), 0.0)
    box.connected(window)

    while not box.is_idle:
        taken = take_all(box)
        assert 0 < len(taken) <= window
        acknowledge(box, taken)
