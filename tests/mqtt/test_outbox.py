"""The outbox: what goes first, what gives way, and that nothing is lost without being declared."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from gateway.contract import Quality, ValueRecord
from gateway.mqtt.message import Message, cleared, message_of
from gateway.mqtt.outbox.backlog import Bounds
from gateway.mqtt.outbox.outbox import Outbox, Outgoing
from gateway.store import Loss, OutboxPage, OutboxRow, Rank, Total
from gateway.store.outbox import ROW_BYTES
from tests.mqtt.outbox_model import EVENT, RESULT, TROUBLES, Trouble, queued, run

WIDE = 1000  # a window that never fills
MESSAGES, SEEDS = 3000, 3  # a hundred thousand, and twenty: tests.lab.outbox_model


@pytest.mark.parametrize("trouble", TROUBLES)
@pytest.mark.parametrize("seed", range(SEEDS))
def test_everything_comes_once_and_in_order_or_is_declared(seed: int, trouble: Trouble) -> None:
    found = run(seed, MESSAGES, trouble)

    assert found["received"] > 0.05 * MESSAGES
    assert trouble.table_is_lost or bool(found["declared"]) == trouble.is_bounded


def outbox(**limits: Bounds) -> Outbox:
    box = Outbox(last_topic="b/gateway/status", boot="run", **limits)
    box.grant_history(10**6)
    return box


def latest(topic: str, text: str = "1", *, qos: int = 1) -> Message:
    return Message(topic, text.encode(), qos=qos, retain=True)


def value(number: int) -> Message:
    record = ValueRecord(
        starter="p", point="current", value=number, unit="A", quality=Quality.GOOD, time_s=0.0, seq=number
    )
    return message_of(record, "b")._replace(payload=str(number).encode())


def event(text: str) -> Message:
    return queued("e", text, sort=EVENT)


def result(text: str) -> Message:
    return queued("r", text, sort=RESULT)


def take_all(box: Outbox) -> list[Outgoing]:
    taken: list[Outgoing] = []
    while (outgoing := box.take()) is not None:
        taken.append(outgoing)
    return taken


def texts(taken: Sequence[Outgoing]) -> str:
    return " ".join(f"{each.message.topic}={each.message.payload.decode()}" for each in taken)


def puts(*messages: Message) -> Callable[[Outbox], None]:
    def put(box: Outbox) -> None:
        for message in messages:
            box.put(message, 0.0)

    return put


def connect(box: Outbox) -> None:
    box.connected(WIDE)


def stage(*messages: Message) -> Callable[[Outbox], None]:
    def stage(box: Outbox) -> None:
        for message in messages:
            box.stage(message, 0.0)

    return stage


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        pytest.param(
            [connect, puts(latest("a"), event("1"), result("1"), event("2"))],
            "e=1 r=1 e=2 a=1",
            id="results and events overtake what is retained, and keep their order",
        ),
        pytest.param(
            [puts(*map(event, "0123")), connect, puts(*map(latest, "abc"))],
            "e=0 a=1 e=1 b=1 e=2 c=1 e=3",
            id="events of an outage give way to every second live value",
        ),
        pytest.param(
            [puts(*map(event, "01")), connect, puts(result("1"), event("2"))],
            "r=1 e=0 e=1 e=2",
            id="a new result does not wait for the events of an outage",
        ),
        pytest.param(
            [connect, puts(latest("a", qos=0)), Outbox.disconnected, puts(latest("a", "2", qos=0)), connect],
            "a=2",
            id="of what is retained with QoS 0 the newest is sent, not what a connection left unsent",
        ),
        pytest.param(
            [connect, stage(result("1")), puts(result("2"), event("1"))],
            "r=2 e=1",
            id="what is staged waits until it is put",
        ),
        pytest.param(
            [connect, stage(result("1")), puts(result("2"), result("1"))],
            "r=1 r=2",
            id="what was staged has the place of its staging",
        ),
        pytest.param(
            [puts(latest("b/gateway/status"), latest("b/x"), latest("b/y")), connect],
            "b/x=1 b/y=1 b/gateway/status=1",
            id="the status is the last of what is retained",
        ),
    ],
)
def test_what_goes_first(steps: Sequence[Callable[[Outbox], None]], expected: str) -> None:
    box = outbox()
    for step in steps:
        step(box)

    assert texts(take_all(box)) == expected


def test_a_forgotten_topic_that_came_back_before_the_acknowledgement_stays() -> None:
    box = outbox()
    connect(box)
    box.put(latest("s/p/state"), 0.0)
    for outgoing in take_all(box):
        box.acked(outgoing.ticket, 0)
    for topic in box.topics():
        box.put(cleared(topic), 0.0)
    taken = take_all(box)

    box.put(latest("s/p/state"), 0.0)
    for outgoing in taken:
        box.acked(outgoing.ticket, 0)

    assert texts(taken) == "s/p/state="
    assert texts(take_all(box)) == "s/p/state=1"


def test_after_a_long_absence_of_the_disk_no_transaction_is_long() -> None:
    box = outbox()
    connect(box)
    for number in range(1800):
        box.put(event(f"{number}"), 0.0)
    box.backlog.losses.add(Loss("memory_full", Rank.EVENT, 1, 1.0, 2.0))
    declared = box.backlog.losses.declare(0.0)
    assert declared is not None
    box.put(event(declared.code), 0.0)

    written, losses = [], []
    while (batch := box.backlog.batch()) is not None:
        box.backlog.written(batch)
        written.append([row.payload.decode() for row in batch.rows])
        losses.append(None if batch.losses is None else len(batch.losses))

    assert max(map(len, written)) == 500
    assert [text for texts in written for text in texts] == [*map(str, range(1800)), "gap"]
    assert losses == [1, None, None, 0], "a loss stays in the table until its event is there"


def test_what_is_needed_stays_in_the_table_after_its_delivery_until_it_is_let_go() -> None:
    box = outbox()
    backlog = box.backlog
    backlog.need("alice/7")
    connect(box)
    for number in ("7", "8"):
        box.put(result(number), 0.0)
    taken = {each.rows[0].key: each for each in take_all(box)}
    written = backlog.batch()
    assert written
    backlog.written(written)

    for each in taken.values():
        box.acked(each.ticket, 0)

    def deleted() -> list[int]:
        batch = backlog.batch()
        return [*batch.gone] if batch else []

    assert box.is_idle
    assert deleted() == [taken["alice/8"].rows[0].id]
    assert deleted() == []
    backlog.let_go("alice/7")
    assert deleted() == [taken["alice/7"].rows[0].id]


def test_what_is_staged_is_not_stored_without_its_command_in_a_new_table() -> None:
    box = outbox()
    box.stage(result("1"), 0.0)
    box.put(event("1"), 0.0)

    box.backlog.lose_table()

    batch = box.backlog.batch()
    assert batch
    assert [(row.payload, row.rank) for row in batch.rows] == [(b"1", Rank.EVENT)]


def test_a_page_of_a_table_that_was_lost_meanwhile_takes_nothing_back() -> None:
    box = outbox()
    box.backlog.expect_table()
    box.backlog.recall({Rank.RESULT: Total(1, 300, 0.0, 1.0)}, ())
    box.backlog.lose_table()
    row = OutboxRow(0, Rank.RESULT, "r", b"old", 0.0, "b", "")
    box.backlog.page(Rank.RESULT, OutboxPage([row], 0, is_last=True))
    box.put(result("new"), 0.0)
    connect(box)

    assert [loss.rows for loss in box.backlog.losses.pending] == [1]
    assert texts(take_all(box)) == "r=old r=new"


def test_a_full_outbox_drops_history_first_then_events_and_results_last() -> None:
    box = outbox(memory=Bounds(4, 10**6))
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
        dropped.append(box.backlog.losses.dropped)

    assert dropped[-6:] == [0, 1, 2, 3, 4, 5]  # the newest value will be reported live
    connect(box)
    assert texts(take_all(box)) == "b/starter/p/value/current=2 r=2 r=3 r=4 r=5"


def test_what_waits_is_counted_until_the_broker_has_it_with_the_age_of_the_oldest() -> None:
    box = outbox()
    box.put(event("12"), 1.0)
    box.put(latest("a"), 3.0)
    connect(box)
    sent = take_all(box)

    counted = {key: box.statistics(10.0)[key] for key in ("depth", "oldest_s", "bytes")}
    for outgoing in sent:
        box.acked(outgoing.ticket, 0)

    assert counted == {"depth": 2, "oldest_s": 9.0, "bytes": (3 + ROW_BYTES) + (20 + 2)}
    assert box.statistics(10.0) == {
        "depth": 0, "oldest_s": 0.0, "bytes": 0, "dropped": 0, "refused": 0, "reconnects": 0,
    }  # fmt: skip
