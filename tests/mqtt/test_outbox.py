from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from gateway.mqtt.contract.payloads import Message
from gateway.mqtt.outbox.outbox import Outgoing
from tests.mqtt.outboxes import (
    WIDE,
    acknowledge,
    event,
    latest,
    outbox,
    result,
    take_all,
    texts,
)


def test_results_and_events_overtake_values_and_keep_their_order() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(latest("a", "1"), 0.0)
    box.put(event("1"), 0.0)
    box.put(result("1"), 0.0)
    box.put(event("2"), 0.0)

    assert texts(take_all(box)) == ["e=1", "r=1", "e=2", "a=1"]


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


def test_a_forgotten_topic_that_came_back_before_the_acknowledgement_stays() -> None:
    box = outbox()
    box.connected(WIDE)
    box.put(latest("s/p/state", "1"), 0.0)
    acknowledge(box, take_all(box))
    box.forget(["s/p"], 0.0)
    taken = take_all(box)

    box.put(latest("s/p/state", "2"), 0.0)
    acknowledge(box, taken)

    assert texts(take_all(box)) == ["s/p/state=2"]


@given(st.lists(st.sampled_from(["put", "connect", "disconnect", "take", "ack", "refuse"]), max_size=80))
def test_stored_messages_arrive_in_order_and_none_is_missing(steps: list[str]) -> None:
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
    assert box.statistics(0.0)["bytes"] == 0


def test_a_subscriber_receives_that_a_final_result_was_reported() -> None:
    box = outbox()
    reported: list[str] = []
    box.on_delivered = reported.append
    box.put(Message("r", b"", qos=1, retain=False, is_queued=True, key="alice/7"), 0.0)
    box.put(result("accepted"), 0.0)
    box.connected(WIDE)
    taken = take_all(box)
    assert reported == []

    acknowledge(box, taken)

    assert reported == ["alice/7"]
