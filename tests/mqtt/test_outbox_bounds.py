from __future__ import annotations

import pytest

from tests.mqtt.outboxes import (
    acknowledge,
    event,
    latest,
    outbox,
    take_all,
    value,
)


def test_the_bytes_are_bounded_too() -> None:
    box = outbox(max_bytes=3000)

    for _ in range(10):
        box.put(event("x" * 1000), 0.0)

    assert box.dropped == 8
    assert box.statistics(0.0)["bytes"] == 2 * (1000 + 21 + 200)


def test_a_message_beyond_all_bounds_is_dropped_and_leaves_nothing_behind() -> None:
    box = outbox(max_bytes=1000)

    box.put(event("x" * 1000), 0.0)

    assert box.dropped == 1
    assert box.is_idle
    assert box.statistics(0.0)["bytes"] == 0


def test_the_statistics_report_how_much_waits_and_since_when() -> None:
    box = outbox()
    assert box.statistics(0.0) == {
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

    assert box.statistics(15.0)["depth"] == 3
    assert box.statistics(15.0)["oldest_s"] == 5.0
    assert box.statistics(15.0)["reconnects"] == 3
    box.acked(taken.ticket, 0)
    assert box.statistics(15.0)["depth"] == 2
    while not box.is_idle:
        acknowledge(box, take_all(box))
    assert box.statistics(15.0)["bytes"] == 0


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
