"""The outbox in memory: what goes first, what waits, what is given up."""

from __future__ import annotations

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import Quality, ValueRecord
from gateway.mqtt.message import Message, message_of
from gateway.mqtt.outbox.outbox import Outbox, Outgoing

WIDE = 1000  # a window that never fills


def outbox(**limits: int) -> Outbox:
    box = Outbox(last_topic="b/gateway/status", boot="run", **limits)
    box.grant_history(10**6)
    return box


def latest(topic: str, text: str) -> Message:
    return Message(topic, text.encode(), qos=1, retain=True)


def value(number: int) -> Message:
    record = ValueRecord(
        starter="p", point="current", value=number, unit="A", quality=Quality.GOOD, time_s=0.0, seq=number
    )
    return message_of(record, "b")._replace(payload=str(number).encode())


def event(text: str) -> Message:
    return Message("e", text.encode(), qos=1, retain=False, is_queued=True, is_droppable=True)


def result(text: str) -> Message:
    return Message("r", text.encode(), qos=1, retain=False, is_queued=True)


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


def test_a_full_outbox_drops_history_first_then_events_and_results_last() -> None:
    box = outbox(max_rows=4)
    dropped = []
    for message in [
        result("1"),
        event("1"),
        result("2"),
        *map(value, range(3)),
        event("2"),
        *map(result, "345"),
    ]:
        box.put(message, 0.0)
        dropped.append(box.dropped)

    assert dropped[-6:] == [1, 2, 2, 3, 4, 5]  # the newest value will be reported live
    box.connected(WIDE)
    assert texts(take_all(box)) == ["b/starter/p/value/current=2", "r=2", "r=3", "r=4", "r=5"]


def test_events_of_an_outage_give_way_to_every_second_live_value() -> None:
    box = outbox()
    for number in range(4):
        box.put(event(str(number)), 0.0)
    box.connected(WIDE)
    for topic in "abc":
        box.put(latest(topic, "1"), 0.0)

    assert texts(take_all(box)) == ["e=0", "a=1", "e=1", "b=1", "e=2", "c=1", "e=3"]
