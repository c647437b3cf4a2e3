"""What waits for the broker, and what its disk is asked to do, step by step."""

from __future__ import annotations

from gateway.mqtt.outbox.backlog import Backlog
from gateway.mqtt.outbox.segment import LOWEST, MessageState, QueuedMessage, Segment, row_of
from gateway.storage.spool import Changes, Kind, Page, Recalled, Row, Share
from tests.mqtt.outboxes import event, result, value

NEVER = 0  # late up to here: nothing


def utc(at_s: float) -> float:
    return 1000.0 + at_s


def stored(*, max_rows: int = 20_000, max_bytes: int = 2**24) -> Backlog:
    made = Backlog(boot="run", max_rows=max_rows, max_bytes=max_bytes)
    made.is_disk_away = lambda: False
    return made


def take(box: Backlog) -> QueuedMessage:
    entry = box.next(NEVER)
    assert entry is not None
    box.take(entry)
    return entry


def sink(box: Backlog, lane: Segment, window: int) -> None:
    lane._window = window
    assert box.collect(utc) is not None
    box.written()


def test_what_is_acknowledged_while_it_is_written_is_deleted_afterwards() -> None:
    box = stored()
    box.put(Kind.EVENT, event("1"), 5.0)
    changes = box.collect(utc)
    assert changes is not None
    assert changes.rows == (Row(1, Kind.EVENT, "run", "e", b"1", None, "", 1005.0),)

    box.done([take(box)])
    box.written()

    assert box.collect(utc) == Changes(gone=((Kind.EVENT, 1),))
    assert box.is_empty


def test_what_could_not_be_written_comes_again_before_what_is_newer() -> None:
    box = stored()
    for number in range(3):
        box.put(Kind.EVENT, event(str(number)), 0.0)
    changes = box.collect(utc)
    assert changes is not None
    box.put(Kind.RESULT, result("3"), 0.0)
    box.done([take(box)])

    box.unwritten(changes)

    again = box.collect(utc)
    assert again is not None
    assert [row.payload for row in again.rows] == [b"1", b"2", b"3"]


def test_what_has_come_with_a_page_is_not_there_twice() -> None:
    box = stored()
    lane = box._new[Kind.VALUE]
    entries = [box.put(Kind.VALUE, event(str(number)), 0.0, is_held=True) for number in range(6)]
    sink(box, lane, window=2)
    assert lane.sunk.rows == 4
    lane._window = 10
    ((asked, wanted),) = box.wanted()
    assert (asked, wanted.after) == (lane, 2)
    rows = tuple(row_of(entry, lambda at_s: at_s) for entry in entries[2:])

    box.page(lane, Page(rows, is_last=True))
    box.cancel(entries[5])

    assert len(lane) == 6
    assert lane.sunk.rows == 0
    assert box.collect(utc) == Changes(gone=((Kind.VALUE, 6),))


def test_a_page_that_comes_after_its_disk_was_lost_is_for_no_one() -> None:
    box = stored()
    for number in range(6):
        box.put(Kind.EVENT, event(str(number)), 0.0)
    lane = box._new[Kind.EVENT]
    sink(box, lane, window=2)
    lane._window = 10
    assert [asked for asked, _ in box.wanted()] == [lane]

    box.lose_disk()
    box.page(lane, Page((), is_last=True))

    assert box.dropped == 4
    assert [loss.rows for loss in box.take_losses(utc)] == [4]
    again = box.collect(utc)
    assert again is not None
    assert [row.payload for row in again.rows] == [b"0", b"1"]


def test_what_sinks_while_a_page_is_on_its_way_is_not_part_of_it() -> None:
    lane = Segment(Kind.EVENT, window=2, end=100)
    entries = [QueuedMessage(number, Kind.EVENT, event("x"), "run", 0.0, lane) for number in range(1, 9)]
    for entry in entries[:5]:
        entry.state = MessageState.WRITTEN
        lane.add(entry)
    lane.thin()
    assert lane.sunk.rows == 3
    lane._window = 10
    wanted = lane.wanted()
    assert wanted is not None
    assert (wanted.after, wanted.before) == (2, 100)
    for entry in entries[5:]:
        lane.add(entry)
        entry.state = MessageState.WRITTEN
    lane.thin()

    missing = lane.page(entries[2:5], upto=5, is_last=True, lost=0)

    assert missing == 0
    assert lane.sunk.rows == 3
    assert [entry.number for entry in lane] == [1, 2, 3, 4, 5]


def test_an_entry_that_is_gone_is_passed_over_at_the_front() -> None:
    box = stored(max_rows=2)
    held = box.put(Kind.VALUE, event("1"), 0.0, is_held=True)
    box.put(Kind.VALUE, event("2"), 0.0)
    box.cancel(held)
    box.cancel(held)
    box.put(Kind.RESULT, result("3"), 0.0)

    box.put(Kind.RESULT, result("4"), 0.0)

    assert box.dropped == 1
    assert [loss.kind for loss in box.take_losses(utc)] == [Kind.VALUE]


def test_what_came_from_the_disk_and_is_on_its_way_is_no_reason_to_drop_what_is_new_for_ever() -> None:
    box = stored(max_bytes=1000)
    box.recall(Recalled({Kind.EVENT: Share(1, 2000, 0.0)}, frozenset(), ()))
    ((lane, wanted),) = box.wanted()
    assert (wanted.after, wanted.before) == (LOWEST, 1)
    box.page(lane, Page((Row(0, Kind.EVENT, "old", "e", b"x" * 2000, None, "", 0.0),), is_last=True))
    old = take(box)

    box.put(Kind.EVENT, event("new"), 0.0)
    assert box.dropped == 1
    box.done([old])
    box.put(Kind.EVENT, event("new"), 0.0)

    assert take(box).message.payload == b"new"


def test_values_that_were_reported_live_after_all_do_not_stay_in_memory() -> None:
    box = stored()
    held = [box.put(Kind.VALUE, value(number), 0.0, is_held=True) for number in range(1000)]
    lane = held[0].segment
    for entry in held[1:]:
        box.cancel(entry)

    assert len(lane) == 1
    assert len(lane._head) + len(lane._tail) < 200
    box.release(held[0])
    assert box.take_history(10) == [held[0]]
